// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <utility>

#include "apvi/core/log.hpp"
#include "runs/warnings.hpp"

namespace apvi::runs {
namespace {

using Warnings = std::vector<std::string>;

// Bias (up to 0.5 m/s²) and scale error (up to 3 %) of a working accelerometer stay below this
// part of gravity, as does the acceleration of a vehicle in water on the median.
constexpr double kMaxGravityError = 0.1;

// Vehicles in water turn slower than this most of the time [rad/s].
constexpr double kMaxMedianRate = 1.5;

// Shocks are single samples; more than this part of them is a unit or a range.
constexpr double kMaxSaturated = 0.01;

// Faster than underwater vehicles: AUVs cruise at 1 to 3 m/s, and a DVL's range of velocity ends
// near 10 m/s [m/s].
constexpr double kMaxSpeed = 10.0;
constexpr double kMinSpeed = 1e-3;  // median [m/s]; devices at rest have more noise
// With a DVL the trajectory is compared with it, twice its high speed and at least this [m/s].
constexpr double kMinSpeedLimit = 3.0;
constexpr double kSpeedMargin = 2.0;
constexpr double kSpeedWindow_s = 1.0;
constexpr int kMinFastWindows = 3;  // one alone may be a correction of the pose

// The gates pass 99 % of the pings of a consistent DVL. Below these parts something is wrong.
constexpr double kMinUsed = 0.5;
constexpr double kMinLock = 0.1;

// The offset of a sensor at the surface is smaller [m].
constexpr double kMinDepth = -0.1;

// Of the pings, that may repeat the one before exactly. At rest some do.
constexpr double kMaxRepeated = 0.2;

void check_gravity(const Evidence& evidence, Warnings& warnings) {
  const auto accel = evidence.samples.median_accel();
  if (!accel || std::abs(*accel / evidence.gravity - 1.0) <= kMaxGravityError) return;
  const auto near = [&](double target) { return std::abs(*accel / target - 1.0) < 0.2; };
  const char* hint = "check the accelerometer's unit, range and calibration";
  if (near(1.0)) {
    hint = "it seems to be in g: convert it to m/s²";
  } else if (near(1000.0)) {
    hint = "it seems to be in milli-g or cm/s²: convert it to m/s²";
  } else if (*accel < 0.5 * evidence.gravity) {
    hint = "gravity seems to be removed: record the raw specific force";
  }
  warnings.push_back(fmt::format(
      "imu: the median specific force is {:.3g} m/s², far from gravity ({:.3g} m/s²): {}", *accel,
      evidence.gravity, hint));
}

void check_gyro(const Evidence& evidence, Warnings& warnings) {
  if (evidence.samples.has_zero_gyro()) {
    warnings.push_back(
        "imu: all angular rates are exactly zero: the gyro is not recorded, or its columns are "
        "not those that were read; headings are wrong");
    return;
  }
  const auto gyro = evidence.samples.median_gyro();
  if (!gyro || *gyro <= kMaxMedianRate) return;
  warnings.push_back(fmt::format(
      "imu: the median angular rate is {:.3g} rad/s, more than vehicles turn: check whether it is "
      "in deg/s",
      *gyro));
}

void check_frozen_imu(const Evidence& evidence, Warnings& warnings) {
  const double length_s = evidence.samples.frozen_imu_s();
  if (length_s == 0.0) return;
  warnings.push_back(fmt::format(
      "imu: its values do not change for {:.1f} s after {:.2f} s, the longest of such times: the "
      "sensor was stuck, or its driver repeated the last values; the pose is wrong from there on",
      length_s, seconds_between(*evidence.samples.first(), evidence.samples.frozen_imu_since())));
}

void check_saturation(const Evidence& evidence, Warnings& warnings) {
  const auto imu = evidence.streams.find("imu");
  if (imu == evidence.streams.end() || !evidence.acoustic) return;
  const std::size_t saturated = evidence.acoustic->saturated_imu;
  const auto samples = static_cast<double>(imu->second.delivered);
  if (static_cast<double>(saturated) <= kMaxSaturated * samples) return;
  warnings.push_back(
      fmt::format("imu: {} of {} samples exceed dipo.inertial.max_gyro or max_accel and were not "
                  "used: check the unit (rad/s, m/s²) and range",
                  saturated, imu->second.delivered));
}

void check_dvl_speed(const Evidence& evidence, Warnings& warnings) {
  const auto locked = evidence.samples.median_dvl_speed();
  // Velocities in mm/s are so fast that every ping is taken for a placeholder.
  const auto speed = locked ? locked : evidence.samples.median_unlocked_speed();
  if (locked && *locked > 0.0 && *locked < kMinSpeed) {
    warnings.push_back(
        fmt::format("dvl: the median speed is {:.2g} m/s, less than the noise of a DVL: check "
                    "whether it is in m/s, although the header says otherwise",
                    *locked));
  }
  if (!speed || *speed <= kMaxSpeed) return;
  warnings.push_back(
      fmt::format("dvl: the median speed is {:.3g} m/s, more than vehicles move: check whether it "
                  "is in mm/s or cm/s, and the placeholder for pings without bottom lock",
                  *speed));
}

template <typename Counts>
double count_of(const Counts& counts, dipo::Verdict verdict) {
  const auto found = counts.find(verdict);
  return found == counts.end() ? 0.0 : static_cast<double>(found->second);
}

void check_acceptance(const AcousticService& acoustic, Warnings& warnings) {
  using dipo::Verdict;
  const auto count = [&](Verdict verdict) { return count_of(acoustic.counts.pings, verdict); };
  const double used = count(Verdict::accepted) + count(Verdict::downweighted);
  const double locked = used + count(Verdict::rejected) + count(Verdict::beams_disagree);
  const double all = locked + count(Verdict::no_lock);
  const double repeated = count(Verdict::repeated);
  if (repeated > kMaxRepeated * (all + repeated)) {
    warnings.push_back(fmt::format(
        "dvl: {:.0f} of {:.0f} pings repeat the one before and were not used: the driver holds its "
        "last value; record each measurement once",
        repeated, all + repeated));
  }
  if (used == 0.0) return;  // reported by check_inputs
  if (used < kMinUsed * locked) {
    warnings.push_back(
        fmt::format("dvl: only {:.0f} of {:.0f} pings with bottom lock were used, as they "
                    "contradict the IMU or each other: check the DVL's mounting, axes and units "
                    "and the IMU's units with `apvi doctor`",
                    used, locked));
  }
  if (locked < kMinLock * all) {
    warnings.push_back(fmt::format(
        "dvl: only {:.0f} of {:.0f} pings had bottom lock: check altitude and validity flags",
        locked, all));
  }
}

void check_depth_sign(const Evidence& evidence, Warnings& warnings) {
  const auto deepest = evidence.samples.high_depth();
  if (!deepest || *deepest >= kMinDepth) return;
  warnings.push_back(
      fmt::format("depth: never below the surface ({:.2f} m at most), but depth is positive "
                  "downward: name the column pos_z if it holds heights, or check the offset",
                  *deepest));
}

void check_constant_depth(const Evidence& evidence, Warnings& warnings) {
  if (!evidence.samples.has_constant_depth()) return;
  warnings.push_back(
      "pressure: all samples are exactly the same: the sensor is stuck, or its value is not "
      "recorded; remove pressure from sensors.use");
}

// A wrong unit or sign of the pressure contradicts the vertical velocity of the DVL.
void check_depths(const AcousticService& acoustic, Warnings& warnings) {
  using dipo::Verdict;
  const auto count = [&](Verdict verdict) { return count_of(acoustic.counts.depths, verdict); };
  const double accepted = count(Verdict::accepted);
  const double all = accepted + count(Verdict::downweighted) + count(Verdict::rejected);
  const bool reported = accepted + count(Verdict::downweighted) == 0.0;  // by check_inputs
  if (reported || accepted >= kMinUsed * all) return;
  warnings.push_back(
      fmt::format("pressure: only {:.0f} of {:.0f} samples agree with DVL and IMU: check its unit "
                  "(dataset.pressure_unit), its sign, and the stamps with `apvi doctor`",
                  accepted, all));
}

// Images bridge gaps in the inertial data; a DVL alone does not tell how the vehicle turned.
void check_gaps(const Evidence& evidence, Warnings& warnings) {
  const auto& gaps = evidence.samples.gaps();
  if (gaps.empty() || vio_served(evidence)) return;
  const auto longest = std::ranges::max_element(
      gaps, {}, [](const SampleStatistics::Pause& gap) { return gap.length_s; });
  warnings.push_back(fmt::format(
      "imu: no samples for {:.1f} s after {:.2f} s{}: how the vehicle turned is unknown; heading "
      "and position are uncertain from there on",
      longest->length_s, seconds_between(*evidence.samples.first(), longest->since),
      gaps.size() == 1 ? "" : fmt::format(", the longest of {} gaps", gaps.size())));
}

// Innovations too large even for the maximum accelerometer noise have another cause.
void check_agreement(const AcousticService& acoustic, Warnings& warnings) {
  if (acoustic.accel_factor < 0.5 * acoustic.max_accel_factor) return;
  warnings.push_back(
      "dvl: DVL and IMU disagree at the end of the run: check the DVL's mounting and axes with "
      "`apvi doctor`, and dipo.initialization.gyro_bias_sigma (MEMS gyros may need 0.1)");
}

struct FastSpans {
  int windows = 0;
  double fastest = 0.0;  ///< [m/s]
};

FastSpans find_fast_spans(const Trajectory& fused, double limit) {
  FastSpans spans;
  if (fused.empty()) return spans;
  const StampedPose* from = &fused.poses.front();
  for (const StampedPose& pose : fused.poses) {
    const double dt = seconds_between(from->stamp, pose.stamp);
    if (dt < kSpeedWindow_s) continue;
    const Eigen::Vector3d moved = pose.T_world_body.translation - from->T_world_body.translation;
    spans.windows += moved.norm() > limit * dt ? 1 : 0;
    spans.fastest = std::max(spans.fastest, moved.norm() / dt);
    from = &pose;
  }
  return spans;
}

void check_speed(const Evidence& evidence, const Trajectory& fused, Warnings& warnings) {
  const auto measured = evidence.samples.high_dvl_speed();
  const bool by_dvl = measured && *measured <= kMaxSpeed;
  const double limit = by_dvl ? std::max(kSpeedMargin * *measured, kMinSpeedLimit) : kMaxSpeed;
  const FastSpans spans = find_fast_spans(fused, limit);
  if (spans.windows < kMinFastWindows) return;
  const std::string reason =
      by_dvl ? fmt::format("the DVL measured {:.2g} m/s", *measured) : "vehicles are slower";
  warnings.push_back(fmt::format(
      "trajectory: up to {:.3g} m/s, but {}: the estimate diverged; check units, axes, calibration "
      "and time offsets with `apvi doctor`",
      spans.fastest, reason));
}

}  // namespace

std::vector<std::string> check_result(const Evidence& evidence, const Trajectory& fused) {
  Warnings warnings;
  check_gravity(evidence, warnings);
  check_gyro(evidence, warnings);
  check_frozen_imu(evidence, warnings);
  check_saturation(evidence, warnings);
  check_dvl_speed(evidence, warnings);
  for (std::string& warning : check_spans(evidence.samples, fused)) {
    warnings.push_back(std::move(warning));
  }
  check_gaps(evidence, warnings);
  check_depth_sign(evidence, warnings);
  check_constant_depth(evidence, warnings);
  if (evidence.acoustic) check_acceptance(*evidence.acoustic, warnings);
  if (evidence.acoustic) check_depths(*evidence.acoustic, warnings);
  if (evidence.acoustic) check_agreement(*evidence.acoustic, warnings);
  check_speed(evidence, fused, warnings);
  return warnings;
}

}  // namespace apvi::runs
