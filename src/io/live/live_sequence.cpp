// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/io/live_sequence.hpp"

#include <fmt/format.h>

#include "io/stream_cleaner.hpp"

namespace apvi::io {
namespace {

std::string name_of(const SensorEvent& event) {
  std::string name(kind_of(event));
  if (const auto* image = std::get_if<ImageFrame>(&event)) name += std::to_string(image->camera);
  return name;
}

}  // namespace

struct LiveSequence::StreamCleaners {
  std::map<std::string, StreamCleaner> of;
  Stamp stamp;  // of the sample being processed
};

LiveSequence::LiveSequence(config::Node rig, const LiveOptions& options)
    : rig_(std::move(rig)),
      options_(options),
      queue_(options.capacity, Overflow::block),
      cleaners_(std::make_shared<StreamCleaners>()) {
  const std::map<std::string, std::string> kinds = {{"imu0", "imu"},
                                                    {"dvl0", "dvl"},
                                                    {"pressure0", "pressure"},
                                                    {"depth0", "depth"},
                                                    {"cam0", "camera"}};
  for (const auto& [section, kind] : kinds) {
    if (rig_.find(section) != nullptr) report_[kind];
  }
}

void LiveSequence::fail(std::exception_ptr error) {
  {
    const std::scoped_lock lock(mutex_);
    error_ = std::move(error);
  }
  finish();
}

void LiveSequence::stop() {
  stop_.request_stop();
  queue_.close();
}

void LiveSequence::clean(SensorEvent event) {
  cleaners_->stamp = stamp_of(event);
  const std::string name = name_of(event);
  auto found = cleaners_->of.find(name);
  if (found == cleaners_->of.end()) {
    const auto where = [cleaners = cleaners_.get()] {
      return fmt::format("live, at {} ns", cleaners->stamp.ns);
    };
    StreamCleaner cleaner(name, Duration::from_seconds(options_.max_time_jump_s),
                          report_[std::string(kind_of(event))], where);
    if (!options_.confirm_first) cleaner.trust_first();
    found = cleaners_->of.emplace(name, std::move(cleaner)).first;
  }
  found->second.push(std::move(event));
}

void LiveSequence::collect_cleaned() {
  for (auto& [name, cleaner] : cleaners_->of) {
    while (!cleaner.ready.empty()) {
      const Stamp stamp = stamp_of(cleaner.ready.front());
      newest_ = std::max(newest_, stamp);
      reorder_buffer_.emplace(stamp, std::move(cleaner.ready.front()));
      cleaner.ready.pop_front();
    }
  }
}

bool LiveSequence::is_due() const {
  if (reorder_buffer_.empty()) return false;
  return ended_ ||
         newest_ - reorder_buffer_.begin()->first >= Duration::from_seconds(options_.reorder_s);
}

std::optional<SensorEvent> LiveSequence::next() {
  while (!is_due() && !ended_) {
    if (auto event = queue_.pop(stop_.get_token())) {
      clean(std::move(*event));
    } else {
      ended_ = true;
      for (auto& [name, cleaner] : cleaners_->of) cleaner.finish();
    }
    collect_cleaned();
  }
  if (stop_.stop_requested() || reorder_buffer_.empty()) {
    finished_ = true;
    const std::scoped_lock lock(mutex_);
    if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
    return std::nullopt;
  }
  auto first = reorder_buffer_.extract(reorder_buffer_.begin());
  ++report_[std::string(kind_of(first.mapped()))].delivered;
  return std::move(first.mapped());
}

}  // namespace apvi::io
