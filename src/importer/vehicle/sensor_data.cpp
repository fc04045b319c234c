// SPDX-License-Identifier: BSD-3-Clause
#include "importer/vehicle/sensor_data.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace apvi::importer {
namespace {

template <typename Data, typename Visit>
void for_each_kind(Data& data, const Visit& visit) {
  visit(data.imu);
  visit(data.dvl);
  visit(data.pressure);
  visit(data.depth);
  visit(data.gnss);
}

template <typename Value>
void replace(std::optional<Value>& value, const std::optional<Value>& other) {
  if (other) value = other;
}

template <typename Sample>
void replace(std::vector<Sample>& samples, std::vector<Sample>&& others) {
  if (!others.empty()) samples = std::move(others);
}

}  // namespace

std::string SensorData::summary() const {
  std::vector<std::string> parts;
  const auto add = [&](std::size_t count, const char* sensor) {
    if (count > 0) parts.push_back(fmt::format("{} of the {}", count, sensor));
  };
  add(imu.size(), "IMU");
  add(dvl.size(), "DVL");
  add(pressure.size() + depth.size(), "pressure sensor");
  add(gnss.size(), "GNSS receiver");
  return fmt::format("{}", fmt::join(parts, ", "));
}

std::optional<std::pair<Stamp, Stamp>> SensorData::span() const {
  std::optional<std::pair<Stamp, Stamp>> span;
  for_each_kind(*this, [&](const auto& samples) {
    if (samples.empty()) return;
    if (!span) span = {samples.front().stamp, samples.back().stamp};
    span->first = std::min(span->first, samples.front().stamp);
    span->second = std::max(span->second, samples.back().stamp);
  });
  return span;
}

void SensorData::put_in_order() {
  for_each_kind(*this, [](auto& samples) {
    std::ranges::stable_sort(samples, {}, [](const auto& s) { return s.stamp; });
    const auto same = [](const auto& a, const auto& b) { return a.stamp == b.stamp; };
    samples.erase(std::unique(samples.begin(), samples.end(), same), samples.end());
  });
}

void SensorData::restrict_to(Stamp from, Stamp to) {
  for_each_kind(*this, [&](auto& samples) {
    std::erase_if(samples, [&](const auto& s) { return s.stamp < from || s.stamp > to; });
  });
}

void SensorData::take(SensorData other) {
  if (!other.imu.empty()) is_forward_right_down = other.is_forward_right_down;
  // A depth and a pressure are the same sensor.
  if (!other.pressure.empty() || !other.depth.empty()) {
    pressure.clear();
    depth.clear();
  }
  replace(imu, std::move(other.imu));
  replace(dvl, std::move(other.dvl));
  replace(pressure, std::move(other.pressure));
  replace(depth, std::move(other.depth));
  replace(gnss, std::move(other.gnss));
  replace(p_body_dvl, other.p_body_dvl);
  replace(water_density, other.water_density);
  replace(surface_pressure_pa, other.surface_pressure_pa);
}

}  // namespace apvi::importer
