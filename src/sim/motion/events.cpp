// SPDX-License-Identifier: BSD-3-Clause
#include "sim/motion/events.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "apvi/core/error.hpp"

namespace apvi::sim {
namespace {

struct KindInfo {
  EventKind kind;
  std::string_view name;
  double default_strength;
  double max_strength;
};

constexpr double kUnbounded = 1e3;
constexpr std::array<KindInfo, 10> kKinds{{
    {EventKind::visibility, "visibility", 1.0, 100.0},
    {EventKind::blackout, "blackout", 1.0, 1.0},
    {EventKind::silt, "silt", 0.9, 1.0},
    {EventKind::low_texture, "low_texture", 1.0, 1.0},
    {EventKind::over_exposure, "over_exposure", 4.0, kUnbounded},
    {EventKind::dropped_frames, "dropped_frames", 1.0, 1.0},
    {EventKind::dvl_loss, "dvl_loss", 1.0, 1.0},
    {EventKind::dvl_outliers, "dvl_outliers", 0.5, 10.0},
    {EventKind::pressure_spikes, "pressure_spikes", 2.0, kUnbounded},
    {EventKind::imu_saturation, "imu_saturation", 1.2, kUnbounded},
}};

const KindInfo& info_of(EventKind kind) {
  return *std::find_if(kKinds.begin(), kKinds.end(), [&](const auto& f) { return f.kind == kind; });
}

bool active(const EventConfig& event, double t_s) {
  return t_s >= event.start_s && t_s < event.end_s;
}

// 0 at the ends of the event, 1 in the middle; the falling ramp is `fade` times as long as the
// rising one.
double envelope(const EventConfig& event, double t_s, double fade) {
  if (!active(event, t_s)) return 0.0;
  const double ramp = std::max(event.ramp_s, 1e-9);
  const double rise = (t_s - event.start_s) / ramp;
  const double fall = (event.end_s - t_s) / (fade * ramp);
  return std::clamp(std::min(rise, fall), 0.0, 1.0);
}

void check(const EventConfig& event, double duration_s) {
  const KindInfo& info = info_of(event.kind);
  if (event.end_s <= event.start_s) {
    fail_input("events: {}: end_s ({} s) must be after start_s ({} s)", info.name, event.end_s,
               event.start_s);
  }
  if (event.start_s >= duration_s) {
    fail_input("events: {}: starts at {} s, after the end of the scene at {} s", info.name,
               event.start_s, duration_s);
  }
  if (event.strength > info.max_strength) {
    fail_input("events: {}: strength {} exceeds the maximum {}", info.name, event.strength,
               info.max_strength);
  }
}

}  // namespace

std::string_view to_string(EventKind kind) {
  return info_of(kind).name;
}

EventSchedule::EventSchedule(std::vector<EventConfig> events, double duration_s,
                             double water_attenuation_length_m)
    : events_(std::move(events)), nominal_length_m_(water_attenuation_length_m) {
  for (EventConfig& event : events_) {
    check(event, duration_s);
    if (event.strength == 0.0) event.strength = info_of(event.kind).default_strength;
  }
}

double EventSchedule::strength(EventKind kind, double t_s) const {
  double worst = 0.0;
  for (const EventConfig& event : events_) {
    if (event.kind == kind && active(event, t_s)) worst = std::max(worst, event.strength);
  }
  return worst;
}

Disturbance EventSchedule::disturbance(double t_s) const {
  Disturbance now;
  now.darkness = strength(EventKind::blackout, t_s);
  if (const double factor = strength(EventKind::over_exposure, t_s); factor > 0.0) {
    now.exposure = factor;
  }
  constexpr double kSettlingFactor = 2.0;
  for (const EventConfig& event : events_) {
    if (event.kind == EventKind::silt) {
      now.silt = std::max(now.silt, event.strength * envelope(event, t_s, kSettlingFactor));
    }
    const double weight = envelope(event, t_s, 1.0);
    if (event.kind != EventKind::visibility || weight == 0.0) continue;
    // Attenuation is proportional to the particle concentration: ramp it, not the length.
    const double attenuation = (1.0 - weight) / nominal_length_m_ + weight / event.strength;
    now.attenuation_length_m = std::min(now.attenuation_length_m.value_or(1e9), 1.0 / attenuation);
  }
  return now;
}

std::string to_csv(const EventSchedule& schedule) {
  std::string csv = "start_s,end_s,kind\n";
  for (const EventConfig& event : schedule.events()) {
    csv += fmt::format("{},{},{}\n", event.start_s, event.end_s, to_string(event.kind));
  }
  return csv;
}

}  // namespace apvi::sim
