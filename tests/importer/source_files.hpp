// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <string>

#include "importer/mp4_bytes.hpp"
#include "support/run_program.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::test {

/// Writes a video of gray images that become brighter, 64 x 48 at 10 Hz; false without the codec.
inline bool write_video(const std::filesystem::path& path, int images) {
  const int codec = path.extension() == ".avi" ? cv::VideoWriter::fourcc('M', 'J', 'P', 'G')
                                               : cv::VideoWriter::fourcc('m', 'p', '4', 'v');
  cv::VideoWriter writer(path.string(), codec, 10.0, {64, 48});
  if (!writer.isOpened()) return false;
  for (int i = 0; i < images; ++i)
    writer.write(cv::Mat(48, 64, CV_8UC3, cv::Scalar::all(20 + 5 * i)));
  writer.release();
  return std::filesystem::exists(path);
}

/// Seconds of telemetry at 20 Hz: at rest, the camera level.
inline std::string payload_at_rest(std::uint64_t second) {
  const std::string stamp = stamp_us(second * 1'000'000);
  const std::vector<std::array<int, 3>> gyro(20, {1, 2, 3});
  const std::vector<std::array<int, 3>> accel(20, {981, 0, 0});
  return device(sensor_stream({.key = "ACCL", .before = stamp, .samples = accel}) +
                sensor_stream({.key = "GYRO", .before = stamp, .samples = gyro}) +
                shutter_stream(stamp, std::vector<float>(10, 0.01F)));
}

inline std::filesystem::path write_photo(const TmpDir& dir, const std::string& name,
                                         int brightness = 100, cv::Size size = {32, 24}) {
  const std::filesystem::path path = dir.path() / name;
  std::filesystem::create_directories(path.parent_path());
  cv::imwrite(path.string(), cv::Mat(size, CV_8UC3, cv::Scalar::all(brightness)));
  return path;
}

}  // namespace apvi::test
