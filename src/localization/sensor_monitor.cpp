// SPDX-License-Identifier: BSD-3-Clause
#include "localization/sensor_monitor.hpp"

#include <algorithm>

#include "apvi/core/log.hpp"

namespace apvi::localization {
namespace {

// Limits the log messages per sensor when a connection is intermittent.
constexpr int kMaxMessages = 20;

}  // namespace

Duration outage_timeout(std::string_view sensor) {
  if (sensor == "imu") return {100'000'000};
  if (sensor == "camera") return {1'000'000'000};
  return {2'000'000'000};
}

bool is_usable(const SensorEvent& event) {
  const auto* ping = std::get_if<DvlSample>(&event);
  return ping == nullptr || ping->valid;
}

void SensorMonitor::process(const SensorEvent& event) {
  const Stamp now = stamp_of(event);
  if (!first_) first_ = now;
  for (auto& [sensor, stream] : streams_) {
    if (!stream.outage && now - stream.last > outage_timeout(sensor)) begin_outage(sensor, stream);
  }
  if (!is_usable(event)) return;
  const std::string sensor(kind_of(event));
  Stream& stream = streams_.try_emplace(sensor, Stream{now, std::nullopt, 0}).first->second;
  if (stream.outage) end_outage(sensor, stream, now);
  stream.last = std::max(stream.last, now);
}

void SensorMonitor::begin_outage(const std::string& sensor, Stream& stream) {
  stream.outage = outages_.size();
  outages_.push_back({sensor, stream.last, std::nullopt});
  if (++stream.messages > kMaxMessages) return;
  log::warning("{}: silent since {:.2f} s{}", sensor, seconds_between(*first_, stream.last),
               stream.messages == kMaxMessages ? "; further outages are not logged" : "");
}

void SensorMonitor::end_outage(const std::string& sensor, Stream& stream, Stamp now) {
  outages_.at(*stream.outage).until = now;
  stream.outage.reset();
  if (stream.messages > kMaxMessages) return;
  log::info("{}: back at {:.2f} s, after {:.2f} s", sensor, seconds_between(*first_, now),
            seconds_between(stream.last, now));
}

}  // namespace apvi::localization
