// SPDX-License-Identifier: BSD-3-Clause
#include "importer/video_frames.hpp"

#include <cstdlib>

#include "apvi/core/error.hpp"

namespace apvi::importer {

cv::VideoCapture open_video(const std::filesystem::path& path, bool keep_sensor_axes) {
  cv::VideoCapture video;
  // FFmpeg reports a broken file on a line of its own; -8 is its AV_LOG_QUIET.
  setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", /*overwrite=*/0);
  try {
    // Others load plugins of the system and take a name with digits for a series of images.
    video.open(path.string(), cv::CAP_FFMPEG);
  } catch (const cv::Exception&) {  // reported below
  }
  if (!video.isOpened()) {
    fail_input("{}: not a video that this OpenCV can read; convert it to H.264 in MP4",
               path.string());
  }
  // A camera that hung upside down turns its images, but not its IMU.
  if (keep_sensor_axes) video.set(cv::CAP_PROP_ORIENTATION_AUTO, 0.0);
  return video;
}

}  // namespace apvi::importer
