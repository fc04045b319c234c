// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/geometry/spline.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"
#include "apvi/sim/events.hpp"
#include "apvi/sim/ray_caster.hpp"

namespace apvi::sim {

/// ideal: no error, no lost ping; a50: a Water Linked A50 as real logs show it.
enum class DvlPreset { ideal, a50 };

/// The `dvl` section of a scene. The numbers are those of the preset `a50`; another preset replaces
/// them all, and keys given beside it replace single ones. Mounting, beams and latency
/// (`time_offset_s`) are the rig's.
struct DvlSimConfig {
  bool enabled = true;
  DvlPreset preset = DvlPreset::a50;
  std::optional<double> rate_hz;
  double noise_floor = 0.0007;
  double noise_per_speed = 0.008;
  double range_noise = 0.002;
  double range_quantum_m = 0.012;
  double scale_error = 0.003;
  double stamp_jitter_s = 0.004;
  double min_range_m = 0.05;
  double max_range_m = 50.0;
  double max_incidence_deg = 60.0;
  double max_speed_m_s = 3.75;
  double relock_period_s = 10.0;
  double relock_s = 0.35;
  double relock_share = 0.5;
  double beam_dropout = 0.003;
  double outlier_share = 0.0005;
  double outlier_m_s = 0.3;

  /// Takes the numbers of a device.
  void use(DvlPreset other);

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled, "whether the vehicle has one");
    const DvlPreset before = preset;
    v("preset", preset,
      config::Choices<DvlPreset>{{"ideal", DvlPreset::ideal}, {"a50", DvlPreset::a50}},
      "device; the keys below replace single numbers of it");
    if (preset != before) use(preset);
    v("rate_hz", rate_hz, Range{0.1, 50.0}, "fixed ping rate; null: by altitude [Hz]");
    v("noise_floor", noise_floor, Range{0.0, 1.0}, "of a beam at rest, one sigma [m/s]");
    v("noise_per_speed", noise_per_speed, Range{0.0, 1.0}, "and what each m/s of speed adds");
    v("range_noise", range_noise, Range{0.0, 0.5}, "of a beam's range, share of it, one sigma");
    v("range_quantum_m", range_quantum_m, Range{0.0, 1.0}, "ranges are multiples of this [m]");
    v("scale_error", scale_error, Range{-0.2, 0.2}, "reported / true velocity - 1");
    v("stamp_jitter_s", stamp_jitter_s, Range{0.0, 1.0}, "of the stamps, one sigma [s]");
    v("min_range_m", min_range_m, Range{0.0, 100.0}, "nearest bottom along a beam [m]");
    v("max_range_m", max_range_m, Range{0.1, 1000.0}, "farthest bottom along a beam [m]");
    v("max_incidence_deg", max_incidence_deg, Range{1.0, 90.0},
      "a surface that is hit more obliquely sends nothing back [deg]");
    v("max_speed_m_s", max_speed_m_s, Range{0.1, 100.0}, "faster beams are ambiguous [m/s]");
    v("relock_period_s", relock_period_s, Range{1.0, 1e6},
      "the bottom is searched afresh this often [s]");
    v("relock_s", relock_s, Range{0.0, 10.0}, "which takes this long, without a ping [s]");
    v("relock_share", relock_share, Range{0.0, 1.0}, "in this share of the searches");
    v("beam_dropout", beam_dropout, Range{0.0, 1.0}, "share of beams lost for no reason");
    v("outlier_share", outlier_share, Range{0.0, 1.0}, "share of beams that lie without saying so");
    v("outlier_m_s", outlier_m_s, Range{0.0, 10.0}, "by up to this much [m/s]");
  }
};

/// Pings from `start` for `duration_s`. A beam is cast from the sensor along the rig's beam vector
/// and is valid when it meets a surface within the device's limits; its velocity is the beam vector
/// times the sensor's velocity R_DB (v_B + w x p_BD). The velocity is the least-squares solution of
/// the valid beams; with fewer than three there is none and the ping is invalid. Stamps are late by
/// the rig's `time_offset_s`.
std::vector<DvlSample> simulate_dvl(const Se3Spline& spline, const RayCaster& world,
                                    const DvlCalibration& dvl, const DvlSimConfig& config,
                                    const EventSchedule& events, Stamp start, double duration_s,
                                    std::uint64_t seed);

/// Least-squares velocity in the sensor frame of the valid beams; nothing with fewer than three.
std::optional<Eigen::Vector3d> velocity_of_beams(
    const std::array<std::optional<DvlBeam>, kDvlBeams>& beams,
    const std::array<Eigen::Vector3d, kDvlBeams>& directions);

}  // namespace apvi::sim
