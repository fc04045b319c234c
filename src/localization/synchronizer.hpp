// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <deque>
#include <map>
#include <optional>
#include <vector>

#include "apvi/sensors/rig.hpp"
#include "imu/sample_buffer.hpp"
#include "localization/acoustic_odometry.hpp"
#include "localization/active_sensors.hpp"
#include "localization/frame_job.hpp"

namespace apvi::localization {

/// The first stage: takes all samples in order, runs the acoustic odometry (if there is a DVL) and
/// turns camera frames into jobs as soon as IMU data have reached them. During a camera outage it
/// creates jobs without images, so that acoustic odometry keeps the later stages running.
class Synchronizer {
 public:
  struct Output {
    std::vector<PingOutput> pings;
    std::vector<FrameJob> frames;
  };

  /// Without a DVL: no acoustic odometry; frames have no state prior. Without an IMU: frames wait
  /// for nothing.
  Synchronizer(const dipo::Config& config, const Rig& rig, const ActiveSensors& sensors);

  Output process(const SensorEvent& event);

  bool has_acoustic_odometry() const { return acoustic_odometry_.has_value(); }
  const AcousticOdometry& acoustic_odometry() const { return *acoustic_odometry_; }
  /// Frames dropped because IMU data never arrived, or only after a gap that began a new segment.
  std::size_t abandoned_frames() const { return abandoned_frames_; }

 private:
  void add(const ImageFrame& image);
  void add(const SensorEvent& event);
  void add(const ImuSample& sample);
  void begin_segment(Stamp last, Stamp now);
  void update_image_period(Stamp stamp);
  void add_imageless_job(Stamp now);
  double swell_m() const;  ///< wave-induced noise of the depth readings, one sigma [m]
  void add_pings(const std::vector<PingOutput>& outputs);
  bool is_ready(const FrameJob& job, Stamp now) const;
  void complete(FrameJob& job);

  Rig rig_;
  double gravity_;  ///< [m/s²]
  double segment_gap_s_;
  bool imu_in_use_;
  bool dvl_scale_;
  std::size_t cameras_;
  std::optional<AcousticOdometry> acoustic_odometry_;
  imu::SampleBuffer imu_;
  std::vector<ImuSample> new_imu_;
  std::map<Stamp, DvlSample> pings_;
  std::vector<vio::DvlMeasurement> new_pings_;
  std::vector<RangePoints> new_range_points_;
  std::vector<vio::PressureDepthMeasurement> new_depths_;
  std::vector<dipo::Report> new_reports_;
  std::deque<FrameJob> pending_jobs_;
  std::optional<Stamp> last_frame_;
  std::optional<Stamp> run_began_;
  int segments_ = 0;                // after the first
  std::optional<Stamp> first_imu_;  // of the segment
  std::optional<Stamp> last_image_;
  bool any_image_ = false;  // in any segment
  Duration image_period_{
      2'000'000'000};  // between the last two images; large at first, as cameras start slowly
  std::size_t abandoned_frames_ = 0;
};

}  // namespace apvi::localization
