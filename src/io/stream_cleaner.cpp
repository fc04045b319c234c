// SPDX-License-Identifier: BSD-3-Clause
#include "io/stream_cleaner.hpp"

#include <algorithm>
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
  } else if (!pending_.empty()) {
    push_after_jump(std::move(event));
  } else {
    push_regular(std::move(event));
  }
}

void StreamCleaner::finish() {
  // Pending samples are far from their neighbors: broken, except the only sample of a stream.
  while (pending_.size() > (last_ ? 0U : 1U)) {
    drop(DropReason::broken_stamp, pending_.back().where);
    pending_.pop_back();
  }
  if (!pending_.empty()) accept(std::move(pending_.front().event));
  pending_.clear();
  resolve_jump_back(false);
  log_counts();
}

void StreamCleaner::restart() {
  ready.clear();
  pending_.clear();
  last_.reset();
  jump_back_.reset();
  jump_back_persists_ = false;
}

void StreamCleaner::log_counts() const {
  for (const auto& [kind, count] : malformed_) {
    if (count > 1) log::warning("{}: {} samples dropped: {}", sensor_, count, kind);
  }
  for (const auto& [reason, count] : report_->dropped) {
    if (count < 2 || (reason == DropReason::malformed && !malformed_.empty())) continue;
    log::warning("{}: {} samples dropped: {}", sensor_, count, to_string(reason));
  }
}

// The first sample has no previous neighbor, so up to two samples that are far apart are held until
// a third one is close to one of them.
void StreamCleaner::push_first(SensorEvent event) {
  if (trust_first_) return accept(std::move(event));
  const Stamp stamp = stamp_of(event);
  for (std::size_t i = pending_.size(); i-- > 0;) {
    if (!within_max_jump(stamp_of(pending_[i].event), stamp)) continue;
    std::swap(pending_[0], pending_[i]);
    while (pending_.size() > 1) {
      drop(DropReason::broken_stamp, pending_.back().where);
      pending_.pop_back();
    }
    accept(std::move(pending_.front().event));
    pending_.clear();
    return push_regular(std::move(event));
  }
  pending_.push_back({std::move(event), where_()});
  if (pending_.size() > 2) {
    drop(DropReason::broken_stamp, pending_.front().where);
    pending_.pop_front();
  }
}

void StreamCleaner::push_after_jump(SensorEvent event) {
  PendingSample pending = std::move(pending_.front());
  pending_.clear();
  if (within_max_jump(stamp_of(pending.event), stamp_of(event))) {
    accept(std::move(pending.event));
  } else {
    drop(DropReason::broken_stamp, pending.where);
  }
  push_regular(std::move(event));
}

void StreamCleaner::push_regular(SensorEvent event) {
  const Stamp stamp = stamp_of(event);
  if (stamp == *last_) return drop(DropReason::duplicate_stamp);
  if (stamp < *last_) {
    jump_back_persists_ = jump_back_persists_ || jump_back_.has_value();
    resolve_jump_back(true);
    if (within_max_jump(stamp, *last_) || jump_back_persists_) {
      report_->largest_step_back = std::max(report_->largest_step_back, *last_ - stamp);
      return drop(DropReason::out_of_order);
    }
    jump_back_ = where_();
    return;
  }
  resolve_jump_back(false);
  jump_back_persists_ = false;
  if (!within_max_jump(stamp, *last_)) {
    pending_.push_back({std::move(event), where_()});
    return;
  }
  accept(std::move(event));
}

void StreamCleaner::accept(SensorEvent event) {
  last_ = stamp_of(event);
  ready.push_back(std::move(event));
}

bool StreamCleaner::within_max_jump(Stamp a, Stamp b) const {
  return (a > b ? a - b : b - a) <= max_jump_;
}

void StreamCleaner::resolve_jump_back(bool persistent) {
  if (!jump_back_) return;
  drop(persistent ? DropReason::out_of_order : DropReason::broken_stamp, *jump_back_);
  jump_back_.reset();
}

void StreamCleaner::drop_malformed(const std::pair<std::string, std::string>& problem) {
  const auto& [kind, text] = problem;
  if (kind.empty()) return drop(DropReason::malformed);
  ++report_->dropped[DropReason::malformed];
  if (++malformed_[kind] > 1) return;
  const std::string where = where_();
  report_->first_drop.emplace(DropReason::malformed, where);
  const std::string shown = text.empty() ? "" : fmt::format(": \"{}\"", text);
  log::warning("{}: {} sample dropped: malformed: {}{}; further drops are counted", where, sensor_,
               kind, shown);
}

void StreamCleaner::drop(DropReason reason, const std::string& where) {
  const std::size_t count = ++report_->dropped[reason];
  if (count > 1) return;
  report_->first_drop[reason] = where;
  log::warning("{}: {} sample dropped: {}; further drops are only counted", where, sensor_,
               to_string(reason));
}

}  // namespace apvi::io
