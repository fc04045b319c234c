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
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"
#include "dipo/filter_history.hpp"
#include "dipo/initializer.hpp"
#include "dipo/noise_tracker.hpp"
#include "dipo/segment.hpp"

namespace apvi::dipo {

/// How a measurement was handled.
enum class Verdict { accepted, downweighted, rejected, no_lock, beams_disagree, repeated, too_old };
std::string_view to_string(Verdict verdict);

/// The outcome of one DVL ping or pressure-depth sample.
struct Report {
  Stamp stamp;
  Verdict verdict = Verdict::accepted;
  double nis = 0.0;           ///< normalized innovation squared (0 if it was not computed)
  int rows = 0;               ///< degrees of freedom of `nis`
  double accel_factor = 1.0;  ///< factors of the adaptive noise model
  double dvl_variance_factor = 1.0;
};

struct Estimate {
  Stamp stamp;
  State state;
  Matrix covariance;  ///< of the error since the start of the segment
  /// Covariance of the pose error that all poses of the segment share, order as in `covariance`;
  /// zero in the first segment. The covariance of the pose in the world is the sum.
  SegmentError::Matrix6 segment_covariance = SegmentError::Matrix6::Zero();
};

/// DVL-inertial-pressure odometry: the error-state Kalman filter of the paper (section III-B). Add
/// samples in order of arrival; estimates are causal. Not thread-safe.
class Dipo {
 public:
  /// Throws InputError if the rig lacks an IMU or a DVL.
  Dipo(const Config& config, const Rig& rig);

  void add(const ImuSample& sample);
  void add(const DvlSample& sample);
  void add(const PressureSample& sample);
  void add(const PressureDepthSample& sample);

  /// False again after a gap in the inertial data of more than `segment_gap_s`, until the next
  /// segment is initialized.
  bool initialized() const { return history_.started(); }
  /// What initialization is waiting for, for the status line; empty once initialized.
  std::string waiting_for() const;
  /// The newest estimate; nullopt before initialization.
  std::optional<Estimate> latest() const;
  /// The estimate at a stamp within the history, including all measurements received so far.
  std::optional<Estimate> at(Stamp stamp) const;
  Stamp newest() const { return history_.newest(); }
  /// Standard deviation of the wave-induced pressure-depth error [m]; correlated over seconds.
  double swell_m() const;

  /// Reports since the previous call.
  std::vector<Report> take_dvl_reports() { return std::exchange(dvl_reports_, {}); }
  std::vector<Report> take_pressure_depth_reports() {
    return std::exchange(pressure_depth_reports_, {});
  }
  std::size_t gaps() const { return gaps_; }
  std::size_t saturated_samples() const { return saturated_samples_; }
  std::size_t zero_velocity_updates() const { return zero_velocity_updates_; }

 private:
  struct PressureDepthReading {
    Stamp stamp;
    double depth_m;
    Eigen::Vector3d p_body_sensor;
    double noise_m;
  };
  using Sample = std::variant<DvlSample, PressureDepthReading>;
  struct UsedPing {
    Stamp stamp;
    Eigen::Quaterniond R_world_body;
    Eigen::Vector3d v_body;
  };

  void add_pressure_depth(const PressureDepthReading& reading);
  void report_dvl(Report report);
  void start(const Initializer::Start& fresh);
  void begin_segment();
  void apply_pending();
  /// False if the sample's time is not yet covered by inertial data.
  bool apply(const DvlSample& ping);
  bool apply(const PressureDepthReading& reading);
  imu::Noise noise_now() const;
  Verdict check_ping(const DvlSample& ping) const;
  FilterHistory::Model dvl_model(const DvlSample& ping, double offset_s) const;
  /// Gates a measurement at its own time. Returns the model to apply, downweighted if necessary, or
  /// nullopt if it is rejected. Fills in the report.
  std::optional<FilterHistory::Model> validate(Stamp stamp, FilterHistory::Model model,
                                               MeasurementGate& gate, Report& report) const;
  void insert_displacement(const DvlSample& ping, Stamp stamp);
  void update_if_stationary(const ImuSample& sample);
  Estimate estimate(Stamp stamp, const Eskf& filter) const;

  Config config_;
  Rig rig_;
  imu::EarthModel world_;
  FilterHistory history_;
  Initializer initializer_;
  VibrationTracker vibration_;
  StationaryDetector stationary_;
  NoiseAdapter adapter_;
  SwellTracker swell_;
  MeasurementGate dvl_gate_;
  MeasurementGate pressure_depth_gate_;
  std::optional<Segment> last_segment_;  // before the current one
  SegmentError segment_error_;           // of the current one
  std::deque<ImuSample> early_imu_;      // before initialization
  std::deque<Sample> pending_;           // waiting for inertial data that cover their stamp
  std::optional<DvlSample> last_ping_;
  std::optional<UsedPing> last_used_ping_;
  std::optional<ImuSample> last_imu_;
  std::vector<Report> dvl_reports_;
  std::vector<Report> pressure_depth_reports_;
  std::size_t gaps_ = 0;
  std::size_t saturated_samples_ = 0;
  std::size_t zero_velocity_updates_ = 0;
};

}  // namespace apvi::dipo
