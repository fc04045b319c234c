// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "apvi/geometry/trajectory.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::io {

/// Writes a ROS1 bag with the message types of underwater recordings (those of the Tank data set).
/// Messages may be written in any order of time. Throws RunError when the file cannot be written,
/// and in a build without rosbag_storage.
class BagWriter {
 public:
  explicit BagWriter(const std::filesystem::path& path);
  /// Closes the bag and logs errors. Call `close` to get them as exceptions.
  ~BagWriter();
  BagWriter(const BagWriter&) = delete;
  BagWriter& operator=(const BagWriter&) = delete;

  /// Delay from a message's stamp to its recording time, as caused by transport. Initially zero.
  void set_record_delay(Duration delay);

  /// sensor_msgs/Imu, without orientation.
  void write_imu(const std::string& topic, const ImuSample& sample);
  /// sensor_msgs/FluidPressure.
  void write_pressure(const std::string& topic, const PressureSample& sample);
  /// nav_msgs/Odometry with minus the depth as pose.pose.position.z, as the Tank data set has it.
  void write_depth(const std::string& topic, const PressureDepthSample& sample,
                   double sigma_m = 0.1);
  /// waterlinked_a50_ros_driver/DVL. Missing values are written as the device does: fom 0, altitude
  /// and beam distance -1, missing beams as invalid.
  void write_dvl(const std::string& topic, const DvlSample& sample);
  /// nav_msgs/Odometry.
  void write_pose(const std::string& topic, const StampedPose& pose);
  /// sensor_msgs/CompressedImage; `format` is "png" or "jpeg", `file` the content of such a file.
  void write_image(const std::string& topic, Stamp stamp, const std::string& format,
                   const std::vector<std::uint8_t>& file);
  /// A message of any type by its definition (as in a bag's connection header) and its bytes.
  void write_raw(const std::string& topic, Stamp stamp, const std::string& type,
                 const std::string& md5, const std::string& definition,
                 const std::vector<std::uint8_t>& bytes);
  void close();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace apvi::io
