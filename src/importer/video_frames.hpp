// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <filesystem>
#include <opencv2/videoio.hpp>

#include "importer/import.hpp"

namespace apvi::importer {

/// Opens a video. Images are turned as the file says unless `keep_sensor_axes`. Throws InputError
/// when it cannot be decoded.
cv::VideoCapture open_video(const std::filesystem::path& path, bool keep_sensor_axes);

/// Presentation times of images: the decoder's, or by the frame rate where it gives none.
class FrameClock {
 public:
  explicit FrameClock(cv::VideoCapture& video) : video_(video), fps_(video.get(cv::CAP_PROP_FPS)) {
    if (!(fps_ > 0.0 && fps_ < kMaxFps)) fps_ = 30.0;
  }
  double fps() const { return fps_; }
  /// Time of the image just grabbed since the first one [s].
  double next() {
    const double position = 1e-3 * video_.get(cv::CAP_PROP_POS_MSEC);
    if (count_++ == 0) first_ = position;
    const double time = position - first_;
    last_ = count_ == 1 || time > last_ ? time : last_ + 1.0 / fps_;
    return last_;
  }

 private:
  static constexpr double kMaxFps = 1000.0;  ///< more is a damaged header
  cv::VideoCapture& video_;
  double fps_;
  std::size_t count_ = 0;
  double first_ = 0.0;
  double last_ = 0.0;
};

/// Which images of a video to keep.
class Selection {
 public:
  explicit Selection(const ImportOptions& options) : options_(options) {}
  bool past_end(double time_s) const {
    const double end = options_.start_s + options_.duration_s;
    return options_.duration_s > 0.0 && time_s > end - kRounding_s;
  }
  bool take(double time_s) {
    if (time_s < options_.start_s - kRounding_s) return false;
    if (count_++ % static_cast<std::size_t>(options_.every) != 0) return false;
    if (options_.fps <= 0.0) return true;
    if (time_s < due_ - kRounding_s) return false;
    const double interval = 1.0 / options_.fps;
    due_ = (time_s - due_ > interval ? time_s : due_) + interval;  // keeps the mean rate
    return true;
  }

 private:
  const ImportOptions& options_;
  static constexpr double kRounding_s = 1e-3;  ///< of times in files
  std::size_t count_ = 0;
  double due_ = 0.0;
};

}  // namespace apvi::importer
