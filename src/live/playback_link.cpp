// SPDX-License-Identifier: BSD-3-Clause
#include "live/playback_link.hpp"

#include <algorithm>
#include <chrono>
#include <thread>
#include <utility>
#include <variant>

#include "live/host_clock.hpp"

namespace apvi::live {
namespace {

io::DatasetConfig dataset_at(const std::string& path) {
  io::DatasetConfig config;
  config.path = path;
  return config;
}

}  // namespace

PlaybackLink::PlaybackLink(const std::string& path, const std::vector<std::string>& sensors,
                           double speed)
    : reader_(io::open_sequence(dataset_at(path), sensors)), speed_(speed) {}

bool PlaybackLink::receive(Receiver& receiver) {
  if (!next_) next_ = reader_->next();
  if (!next_) return false;
  const Stamp stamp = stamp_of(*next_);
  if (!first_) {
    first_ = stamp;
    began_ = host_now();
  }
  // The vehicle's clock, which runs faster than the recording's by the factor.
  const Stamp due = began_ + Duration::from_seconds(seconds_between(*first_, stamp) / speed_);
  const Duration ahead = due - host_now();
  if (ahead.ns > 0) {
    const std::chrono::nanoseconds poll = kPollPeriod;
    std::this_thread::sleep_for(std::min(std::chrono::nanoseconds(ahead.ns), poll));
    if (std::chrono::nanoseconds(ahead.ns) > poll) return true;
  }
  SensorEvent event = std::move(*std::exchange(next_, std::nullopt));
  std::visit([&](auto& sample) { sample.stamp = due; }, event);
  receiver.sample(std::move(event), {.sent = due, .arrival = host_now()});
  return true;
}

}  // namespace apvi::live
