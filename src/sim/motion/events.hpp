// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string_view>
#include <vector>

#include "apvi/config/fields.hpp"
#include "sim/motion/disturbance.hpp"

namespace apvi::sim {

enum class EventKind {
  visibility,
  blackout,
  silt,
  low_texture,
  over_exposure,
  dropped_frames,
  dvl_loss,
  dvl_outliers,
  pressure_spikes,
  imu_saturation,
};

std::string_view to_string(EventKind kind);

/// A disturbance from `start_s` to `end_s` after the start of the recording. The meaning of
/// `strength` depends on the kind; 0 selects the default in parentheses:
///   visibility       attenuation length [m] (1): ramps down, holds, ramps up again
///   blackout         darkness in [0, 1] (1): sudden loss of all light
///   silt             density of the cloud in [0, 1] (0.9): builds up fast, settles slowly
///   low_texture      no effect of its own: marks a stretch over bare ground (`world.bare_patches`)
///   over_exposure    factor on the gain (4)
///   dropped_frames   fraction of frames that are lost, in [0, 1] (1)
///   dvl_loss         fraction of pings without bottom lock, in [0, 1] (1)
///   dvl_outliers     magnitude of the outliers [m/s] (0.5), in a third of the pings
///   pressure_spikes  magnitude of the spikes [m] (2), in a tenth of the samples
///   imu_saturation   vibration amplitude / accelerometer range (1.2)
struct EventConfig {
  EventKind kind = EventKind::blackout;
  double start_s = 0.0;
  double end_s = 0.0;
  double strength = 0.0;
  double ramp_s = 2.0;

  template <typename V>
  void visit(V& v);
};

/// The events of a scene, queried by the renderer and the sensor models.
class EventSchedule {
 public:
  EventSchedule() = default;
  /// `water_attenuation_length_m`: the nominal visibility of the scene, from which the ramps start.
  /// Throws InputError for an event that ends before it starts, starts after `duration_s`, or has a
  /// strength outside the range of its kind.
  EventSchedule(std::vector<EventConfig> events, double duration_s,
                double water_attenuation_length_m);

  const std::vector<EventConfig>& events() const { return events_; }
  /// Strength of the given kind at `t_s`; 0 when no such event is active.
  double strength(EventKind kind, double t_s) const;
  /// Disturbance of the camera at `t_s`.
  Disturbance disturbance(double t_s) const;

 private:
  std::vector<EventConfig> events_;
  double nominal_length_m_ = 10.0;
};

/// The schedule as CSV: start_s, end_s, kind.
std::string to_csv(const EventSchedule& schedule);

template <typename V>
void EventConfig::visit(V& v) {
  using config::Range;
  v("kind", kind,
    config::Choices<EventKind>{{"visibility", EventKind::visibility},
                               {"blackout", EventKind::blackout},
                               {"silt", EventKind::silt},
                               {"low_texture", EventKind::low_texture},
                               {"over_exposure", EventKind::over_exposure},
                               {"dropped_frames", EventKind::dropped_frames},
                               {"dvl_loss", EventKind::dvl_loss},
                               {"dvl_outliers", EventKind::dvl_outliers},
                               {"pressure_spikes", EventKind::pressure_spikes},
                               {"imu_saturation", EventKind::imu_saturation}},
    "what happens");
  v("start_s", start_s, Range{0.0, 1e6}, "when it begins [s]");
  v("end_s", end_s, Range{0.0, 1e6}, "when it is over [s]");
  v("strength", strength, Range{0.0, 1e3}, "how bad, in the kind's unit; 0: its default");
  v("ramp_s", ramp_s, Range{0.0, 1e3}, "time to build up and to fade (visibility, silt) [s]");
}

}  // namespace apvi::sim
