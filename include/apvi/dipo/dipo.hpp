// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <deque>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "apvi/dipo/config.hpp"
#include "apvi/dipo/initializer.hpp"
#include "apvi/dipo/noise_tracker.hpp"
#include "apvi/dipo/timeline.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::dipo {

/// What became of a measurement.
enum class Verdict { accepted, weakened, rejected, no_lock, beams_disagree, repeated, too_old };
std::string_view to_string(Verdict verdict);

/// One DVL ping or depth sample and what the filter made of it.
struct Report {
  Stamp stamp;
  Verdict verdict = Verdict::accepted;
  double nis = 0.0;           ///< normalised innovation squared (0 when none was computed)
  int rows = 0;               ///< its degrees of freedom
  double accel_factor = 1.0;  ///< what the adaptive noises have reached
  double dvl_variance_factor = 1.0;
};

struct Estimate {
  Stamp stamp;
  State state;
  Matrix covariance;
};

/// DVL-inertial-pressure odometry: the paper's ESKF subsystem (section III-B). Samples come in the
/// order in which they become known; estimates are causal. Not thread-safe.
class Dipo {
 public:
  /// Throws InputError when the rig lacks an IMU or a DVL.
  Dipo(const Config& config, const Rig& rig);

  void add(const ImuSample& sample);
  void add(const DvlSample& sample);
  void add(const PressureSample& sample);
  void add(const DepthSample& sample);

  bool initialized() const { return timeline_.started(); }
  /// Says what initialization waits for, for the status line; empty once it is done.
  std::string waiting_for() const;
  /// The newest estimate; nothing before initialization.
  std::optional<Estimate> latest() const;
  /// The estimate at a stamp inside the history, everything known by now taken in.
  std::optional<Estimate> at(Stamp stamp) const;
  Stamp newest() const { return timeline_.newest(); }
  /// What waves add to readings of depth just now [m]: a standard deviation, for seconds the same.
  double swell_m() const;

  /// Reports since the last call.
  std::vector<Report> take_dvl_reports() { return std::exchange(dvl_reports_, {}); }
  std::vector<Report> take_depth_reports() { return std::exchange(depth_reports_, {}); }
  std::size_t gaps() const { return gaps_; }
  std::size_t saturated_samples() const { return saturated_samples_; }
  std::size_t zero_velocity_updates() const { return zero_velocity_updates_; }

 private:
  struct DepthReading {
    Stamp stamp;
    double depth_m;
    Eigen::Vector3d p_body_sensor;
    double noise_m;
  };
  using Sample = std::variant<DvlSample, DepthReading>;
  struct UsedPing {
    Stamp stamp;
    Eigen::Quaterniond R_world_body;
    Eigen::Vector3d v_body;
  };

  void add_depth(const DepthReading& reading);
  void report_dvl(Report report);
  void start(const Initializer::Start& start);
  void take_in_pending();
  /// False while the sample's own time is still ahead of the inertial data.
  bool take_in(const DvlSample& ping);
  bool take_in(const DepthReading& reading);
  imu::Noise noise_now() const;
  Verdict verdict_before_filter(const DvlSample& ping) const;
  Timeline::Model dvl_model(const DvlSample& ping, double offset_s) const;
  /// Passes a measurement through its gate, at its own time: the model to take in, weakened or not,
  /// or nothing. Fills the report.
  std::optional<Timeline::Model> judge(Stamp stamp, Timeline::Model model, MeasurementGate& gate,
                                       Report& report) const;
  void insert_displacement(const DvlSample& ping, Stamp stamp);
  void update_if_still(const ImuSample& sample);

  Config config_;
  Rig rig_;
  imu::World world_;
  Timeline timeline_;
  Initializer initializer_;
  VibrationTracker vibration_;
  StillnessDetector stillness_;
  NoiseAdapter adapter_;
  SwellTracker swell_;
  MeasurementGate dvl_gate_;
  MeasurementGate depth_gate_;
  std::deque<ImuSample> early_imu_;  // before initialization
  std::deque<Sample> pending_;       // whose own time the inertial data have not reached
  std::optional<DvlSample> last_ping_;
  std::optional<UsedPing> last_used_ping_;
  std::optional<ImuSample> last_imu_;
  std::vector<Report> dvl_reports_;
  std::vector<Report> depth_reports_;
  std::size_t gaps_ = 0;
  std::size_t saturated_samples_ = 0;
  std::size_t zero_velocity_updates_ = 0;
};

}  // namespace apvi::dipo
