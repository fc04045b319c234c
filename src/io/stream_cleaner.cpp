// SPDX-License-Identifier: BSD-3-Clause
#include "io/stream_cleaner.hpp"

#include <utility>

#include "apvi/core/log.hpp"

namespace apvi::io {

StreamCleaner::StreamCleaner(std::string sensor, Duration max_jump, StreamReport& report,
                             std::function<std::string()> where)
    : sensor_(std::move(sensor)), max_jump_(max_jump), report_(&report), where_(std::move(where)) {}

void StreamCleaner::push(SensorEvent event) {
  if (!is_finite(event)) {
    drop(DropReason::not_finite);
  } else if (!last_) {
    push_first(std::move(event));
  } else if (!held_.empty()) {
    push_after_jump(std::move(event));
  } else {
    push_regular(std::move(event));
  }
}

void StreamCleaner::finish() {
  // What is still held has one neighbour at most, and lies far from it: broken, unless it is alone.
  while (held_.size() > (last_ ? 0U : 1U)) {
    drop(DropReason::broken_stamp, held_.back().where);
    held_.pop_back();
  }
  if (!held_.empty()) accept(std::move(held_.front().event));
  held_.clear();
  settle_jump_back(false);
}

// The first sample has no neighbour before it, so up to two samples that are far apart wait for a
// third, which stands by one of them.
void StreamCleaner::push_first(SensorEvent event) {
  const Stamp stamp = stamp_of(event);
  for (std::size_t i = held_.size(); i-- > 0;) {
    if (!near(stamp_of(held_[i].event), stamp)) continue;
    std::swap(held_[0], held_[i]);
    while (held_.size() > 1) {
      drop(DropReason::broken_stamp, held_.back().where);
      held_.pop_back();
    }
    accept(std::move(held_.front().event));
    held_.clear();
    return push_regular(std::move(event));
  }
  held_.push_back({std::move(event), where_()});
  if (held_.size() > 2) {
    drop(DropReason::broken_stamp, held_.front().where);
    held_.pop_front();
  }
}

void StreamCleaner::push_after_jump(SensorEvent event) {
  Held held = std::move(held_.front());
  held_.clear();
  if (near(stamp_of(held.event), stamp_of(event))) {
    accept(std::move(held.event));
  } else {
    drop(DropReason::broken_stamp, held.where);
  }
  push_regular(std::move(event));
}

void StreamCleaner::push_regular(SensorEvent event) {
  const Stamp stamp = stamp_of(event);
  if (stamp == *last_) return drop(DropReason::duplicate_stamp);
  if (stamp < *last_) {
    back_persists_ = back_persists_ || back_.has_value();
    settle_jump_back(true);
    if (near(stamp, *last_) || back_persists_) return drop(DropReason::out_of_order);
    back_ = where_();
    return;
  }
  settle_jump_back(false);
  back_persists_ = false;
  if (!near(stamp, *last_)) {
    held_.push_back({std::move(event), where_()});
    return;
  }
  accept(std::move(event));
}

void StreamCleaner::accept(SensorEvent event) {
  last_ = stamp_of(event);
  ready.push_back(std::move(event));
}

bool StreamCleaner::near(Stamp a, Stamp b) const {
  return (a > b ? a - b : b - a) <= max_jump_;
}

void StreamCleaner::settle_jump_back(bool persistent) {
  if (!back_) return;
  drop(persistent ? DropReason::out_of_order : DropReason::broken_stamp, *back_);
  back_.reset();
}

void StreamCleaner::drop(DropReason reason, const std::string& where) {
  const std::size_t count = ++report_->dropped[reason];
  if (count > 1) return;
  report_->first_drop[reason] = where;
  log::warning("{}: {} sample dropped: {}; further ones are only counted", where, sensor_,
               to_string(reason));
}

}  // namespace apvi::io
