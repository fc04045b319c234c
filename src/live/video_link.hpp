// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/videoio.hpp>
#include <optional>
#include <string>

#include "live/link.hpp"
#include "live/source_url.hpp"

namespace apvi::live {

bool is_video_scheme(const std::string& scheme);

struct VideoOptions {
  SourceUrl url;
  int camera = 0;        ///< of the rig: 0 or 1
  double delay_s = 0.0;  ///< of the camera and the link, which stamps are corrected for
};
/// Throws InputError for unknown options.
VideoOptions video_options(const SourceUrl& url);

/// A camera, or a video file played at its pace, by OpenCV with FFmpeg. The stamp of an image is
/// its presentation time, aligned to the arrival, less the given delay; without a presentation time
/// it is the arrival.
class VideoLink : public Link {
 public:
  /// Throws RunError when there is no video.
  explicit VideoLink(const VideoOptions& options);
  bool receive(Receiver& receiver) override;

 private:
  ClockReading reading_at(Stamp arrival);
  bool wait_until_due();

  VideoOptions options_;
  cv::VideoCapture capture_;
  bool is_file_;
  std::optional<double> next_ms_;  // a file's grabbed image
  std::optional<Stamp> began_;     // playing a file
  double last_ms_ = -1.0;
};

}  // namespace apvi::live
