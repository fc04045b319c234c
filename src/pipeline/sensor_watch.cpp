// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/pipeline/sensor_watch.hpp"

#include <algorithm>
#include <string_view>

#include "apvi/core/log.hpp"

namespace apvi::pipeline {
namespace {

// Messages about one sensor; a loose plug must not fill the log.
constexpr int kMostMessages = 20;

// Longer than the slowest of its kind takes between two samples.
Duration patience(std::string_view sensor) {
  if (sensor == "imu") return {100'000'000};
  if (sensor == "camera") return {1'000'000'000};
  return {2'000'000'000};
}

bool is_usable(const SensorEvent& event) {
  const auto* ping = std::get_if<DvlSample>(&event);
  return ping == nullptr || ping->valid;
}

}  // namespace

void SensorWatch::see(const SensorEvent& event) {
  const Stamp now = stamp_of(event);
  if (!first_) first_ = now;
  for (auto& [sensor, stream] : streams_) {
    if (!stream.outage && now - stream.last > patience(sensor)) fall_silent(sensor, stream);
  }
  if (!is_usable(event)) return;
  const std::string sensor(kind_of(event));
  Stream& stream = streams_.try_emplace(sensor, Stream{now, std::nullopt, 0}).first->second;
  if (stream.outage) come_back(sensor, stream, now);
  stream.last = std::max(stream.last, now);
}

void SensorWatch::fall_silent(const std::string& sensor, Stream& stream) {
  stream.outage = outages_.size();
  outages_.push_back({sensor, stream.last, std::nullopt});
  if (++stream.said > kMostMessages) return;
  log::warning("{}: silent since {:.2f} s{}", sensor, seconds_between(*first_, stream.last),
               stream.said == kMostMessages ? "; more of this is not said" : "");
}

void SensorWatch::come_back(const std::string& sensor, Stream& stream, Stamp now) {
  outages_.at(*stream.outage).until = now;
  stream.outage.reset();
  if (stream.said > kMostMessages) return;
  log::info("{}: back at {:.2f} s, after {:.2f} s", sensor, seconds_between(*first_, now),
            seconds_between(stream.last, now));
}

}  // namespace apvi::pipeline
