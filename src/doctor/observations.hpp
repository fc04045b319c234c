// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"
#include "doctor/log_histogram.hpp"

namespace apvi::doctor {

/// Timing statistics of a sensor.
struct Timing {
  std::size_t count = 0;
  Stamp first;
  Stamp last;
  LogHistogram steps;         ///< between consecutive samples [s]
  double longest_step = 0.0;  ///< [s]
  Stamp longest_at;           ///< start of the longest step
  std::size_t repeated = 0;   ///< samples identical to the previous one

  void add(Stamp stamp, bool repeats);
  double span_s() const { return count > 1 ? seconds_between(first, last) : 0.0; }
  /// From the median step [Hz]; zero with fewer than two samples.
  double rate_hz() const { return steps.median() > 0.0 ? 1.0 / steps.median() : 0.0; }
};

struct ImuObservations {
  Timing timing;
  LogHistogram accel_norm;  ///< [m/s²]
  LogHistogram gyro_norm;   ///< [rad/s]
  Eigen::Vector3d accel_sum = Eigen::Vector3d::Zero();
  std::vector<ImuSample> buffer;
};

/// Second moments of beam velocities and the velocity vector over pings with four valid beams.
struct BeamMoments {
  std::size_t count = 0;
  Eigen::Matrix4d beam_beam = Eigen::Matrix4d::Zero();  ///< sum of b bᵀ
  Eigen::Matrix<double, 3, 4> velocity_beam = Eigen::Matrix<double, 3, 4>::Zero();  ///< sum of v bᵀ
  Eigen::Matrix3d velocity_velocity = Eigen::Matrix3d::Zero();  ///< sum of v vᵀ

  void add(const DvlSample& sample);
};

struct DvlPing {
  Stamp stamp;
  Eigen::Vector3d velocity;  ///< as reported [m/s]
};

inline constexpr double kMaxVehicleSpeed = 15.0;  // [m/s]

struct DvlObservations {
  Timing timing;
  std::size_t valid = 0;
  std::size_t zero = 0;        ///< valid, and exactly zero on every axis
  std::size_t with_beams = 0;  ///< valid, with at least one beam reported
  std::size_t four_beams = 0;  ///< valid, with four valid beams
  std::optional<Stamp> last_valid;
  double longest_dropout = 0.0;  ///< between valid pings [s]
  Stamp dropout_at;
  LogHistogram speed;  ///< of valid pings [m/s]
  LogHistogram
      excessive_speed;  ///< of invalid pings faster than any vehicle, without repeats [m/s]
  LogHistogram figure_of_merit;  ///< of all pings [m/s]
  BeamMoments beams;
  std::vector<DvlPing> buffer;  ///< valid pings that differ from the previous one
};

struct DepthPoint {
  Stamp stamp;
  double depth = 0.0;  ///< at the sensor [m]
};

/// Observations of a pressure or depth sensor.
struct DepthObservations {
  Timing timing;
  LogHistogram value;        ///< pressure [Pa], or |depth| [m]
  LogHistogram depth_step;   ///< nonzero |change| between consecutive samples [m]
  std::size_t spikes = 0;    ///< changes too fast for any vehicle
  std::size_t negative = 0;  ///< clearly above the surface
  double lowest = 0.0;       ///< depth [m]
  double highest = 0.0;      ///< depth [m]
  std::vector<DepthPoint> buffer;
};

struct CameraObservations {
  Timing timing;
  std::optional<std::array<int, 2>> size;  ///< of the first image [px]
  std::string decode_error;                ///< error of decoding the first image
};

/// Observations of one pass over a recording.
struct Observations {
  ImuObservations imu;
  DvlObservations dvl;
  DepthObservations pressure;
  DepthObservations depth;
  std::array<CameraObservations, 2> cameras;
  Timing gnss;
  std::map<std::string, io::StreamReport> streams;
  std::optional<Trajectory> reference;
};

/// Collects observations from events in order of time.
class Collector {
 public:
  explicit Collector(const Rig& rig) : rig_(rig) {}
  void add(const SensorEvent& event);
  Observations take() { return std::move(observed_); }

 private:
  void add_imu(const ImuSample& sample);
  void add_dvl(const DvlSample& sample);
  void add_depth(DepthObservations& observed, Stamp stamp, double value, double depth);
  void add_image(const ImageFrame& frame);
  void start_window(Stamp stamp);
  bool in_window(Stamp stamp);

  Rig rig_;
  Observations observed_;
  std::optional<Stamp> window_end_;
  bool window_fixed_ = false;  // set by the first DVL ping with motion
  std::optional<ImuSample> last_imu_;
  std::optional<DvlSample> last_dvl_;
  std::map<const DepthObservations*, DepthPoint> last_depth_;
};

}  // namespace apvi::doctor
