// SPDX-License-Identifier: BSD-3-Clause
#include "runs/sensor_spans.hpp"

#include <algorithm>
#include <string_view>

#include "localization/sensor_monitor.hpp"

namespace apvi::runs {

void SensorSpans::add(const SensorEvent& event) {
  if (!localization::is_usable(event)) return;
  const std::string_view sensor = kind_of(event);
  const Stamp now = stamp_of(event);
  auto found = by_sensor_.find(sensor);
  if (found == by_sensor_.end()) found = by_sensor_.try_emplace(std::string(sensor)).first;
  std::vector<SensorSpan>& spans = found->second;
  if (spans.empty() || now - spans.back().end > localization::outage_timeout(sensor)) {
    spans.push_back({found->first, now, now, 0});
  }
  spans.back().end = std::max(spans.back().end, now);
  ++spans.back().samples;
}

std::vector<SensorSpan> SensorSpans::all() const {
  std::vector<SensorSpan> spans;
  for (const auto& [sensor, some] : by_sensor_) spans.insert(spans.end(), some.begin(), some.end());
  return spans;
}

}  // namespace apvi::runs
