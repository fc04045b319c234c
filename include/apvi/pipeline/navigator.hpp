// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <deque>
#include <map>
#include <optional>
#include <vector>

#include "apvi/imu/sample_buffer.hpp"
#include "apvi/pipeline/frame_job.hpp"
#include "apvi/pipeline/localization.hpp"
#include "apvi/sensors/rig.hpp"

namespace apvi::pipeline {

/// The first stage: takes every sample in order, runs the acoustic odometry (when the rig has a
/// DVL) and turns camera frames into jobs as soon as the inertial data have reached them. While the
/// cameras are silent and there is acoustic odometry, jobs without images keep the rest going.
class Navigator {
 public:
  struct Output {
    std::vector<LocalizationOutput> pings;
    std::vector<FrameJob> frames;
  };

  /// `use_dvl` false: no acoustic odometry, frames come without an aid.
  Navigator(const dipo::Config& config, const Rig& rig, bool use_dvl, std::size_t cameras);

  Output process(const SensorEvent& event);

  bool has_dipo() const { return localization_.has_value(); }
  const Localization& localization() const { return *localization_; }
  /// Frames given up because inertial data never came.
  std::size_t abandoned_frames() const { return abandoned_frames_; }

 private:
  void take(const ImageFrame& image);
  void take(const SensorEvent& event);
  void note_image(Stamp stamp);
  void bridge_silence(Stamp now);
  double swell_m() const;  ///< of the depth readings [m]
  void note_pings(const std::vector<LocalizationOutput>& outputs);
  bool is_ready(const FrameJob& job, Stamp now) const;
  void complete(FrameJob& job);

  Rig rig_;
  std::size_t cameras_;
  std::optional<Localization> localization_;
  imu::SampleBuffer imu_;
  std::vector<ImuSample> fresh_imu_;
  std::map<Stamp, DvlSample> raw_pings_;
  std::vector<vio::DvlMeasurement> fresh_pings_;
  std::vector<RangedPing> fresh_ranges_;
  std::vector<vio::DepthMeasurement> fresh_depths_;
  std::vector<dipo::Report> fresh_reports_;
  std::deque<FrameJob> waiting_;
  std::optional<Stamp> last_frame_;
  std::optional<Stamp> first_imu_;
  std::optional<Stamp> last_image_;
  Duration image_period_{2'000'000'000};  // between the last two; a camera may be slow to start
  std::size_t abandoned_frames_ = 0;
};

}  // namespace apvi::pipeline
