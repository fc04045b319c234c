// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>

#include "apvi/config/node.hpp"
#include "apvi/sensors/samples.hpp"
#include "core/worker.hpp"
#include "live/options.hpp"

namespace apvi::live {

/// Writes samples into a dataset folder, without loss: numbers and images read back exactly. On its
/// own thread; when the disk is slow, images are left out and counted; when it fails, recording
/// stops with one message. The caller goes on in both cases.
class Recorder {
 public:
  /// Creates the folder with `rig` as its calibration; samples of sensors that the rig does not
  /// describe are ignored. Throws RunError when it cannot be created.
  Recorder(std::filesystem::path folder, const config::Node& rig,
           ImageFormat images = ImageFormat::png);

  /// Thread-safe; never waits for the disk.
  void push(const SensorEvent& event);
  /// Writes what is queued.
  void finish();

  std::size_t dropped_images() const { return dropped_images_; }
  bool failed() const { return failed_; }

 private:
  void open(const std::string& sensor, std::string_view header);
  void process(const SensorEvent& event);
  void write(const SensorEvent& event);
  void write(const ImageFrame& image);
  void add_row(const std::string& sensor, const std::string& row);
  void flush();

  std::filesystem::path folder_;
  ImageFormat images_;
  std::map<std::string, std::ofstream> files_;  // by sensor: "imu0", …
  std::chrono::steady_clock::time_point flushed_ = std::chrono::steady_clock::now();
  std::atomic<std::size_t> waiting_images_ = 0;
  std::atomic<std::size_t> dropped_images_ = 0;
  std::atomic<bool> failed_ = false;
  Worker<SensorEvent> worker_;  // last: its thread uses the others
};

}  // namespace apvi::live
