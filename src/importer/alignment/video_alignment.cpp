// SPDX-License-Identifier: BSD-3-Clause
#include "importer/alignment/video_alignment.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "apvi/config/node.hpp"
#include "apvi/core/error.hpp"
#include "apvi/sensors/rig.hpp"
#include "core/status_line.hpp"
#include "doctor/pair_collector.hpp"
#include "importer/sources.hpp"
#include "importer/video_frames.hpp"

namespace apvi::importer {
namespace {

constexpr double kMaxTime_s = 600.0;  // of images
constexpr int kMaxWidth_px = 640;     // more does not help

Stamp at(double time_s) {
  return Stamp{} + Duration::from_seconds(time_s);
}

// Pairs of reduced images.
class PairReader {
 public:
  explicit PairReader(const ImportOptions& options)
      : options_(options), span_{at(options.start_s), at(options.start_s + length(options))} {}

  double end_s() const { return span_.to.seconds(); }

  void add(cv::VideoCapture& video, double time_s) {
    if (time_s < options_.start_s) return;
    if (collector_ && !collector_->wants(at(time_s))) return;
    cv::Mat image;
    if (!video.retrieve(image) || image.empty()) return;
    if (!collector_) start(image);
    if (image.cols != recorded_.width || image.rows != recorded_.height) return;
    cv::resize(image, image, {size_.width, size_.height}, 0.0, 0.0, cv::INTER_AREA);
    if (collector_->wants(at(time_s))) collector_->add(image, at(time_s));
  }

  ImageSize size() const { return size_; }
  std::vector<doctor::ImagePair> take() {
    return collector_ ? collector_->take() : std::vector<doctor::ImagePair>{};
  }

 private:
  static double length(const ImportOptions& options) {
    return options.duration_s > 0.0 ? std::min(options.duration_s, kMaxTime_s) : kMaxTime_s;
  }
  void start(const cv::Mat& image) {
    recorded_ = {image.cols, image.rows};
    size_ = scaled(recorded_, std::min(1.0, static_cast<double>(kMaxWidth_px) / image.cols));
    collector_.emplace(std::vector<doctor::TimeSpan>{span_}, cv::Size(size_.width, size_.height),
                       cv::Mat());
  }

  const ImportOptions& options_;
  doctor::TimeSpan span_;
  ImageSize recorded_;
  ImageSize size_;
  std::optional<doctor::ImagePairCollector> collector_;
};

CameraModel camera_for(const ImportOptions& options, const std::optional<FieldOfView>& known,
                       ImageSize size) {
  if (options.rig.empty()) {
    const FieldOfView view = field_of_view(options, known);
    return CameraModel(assumed_camera(view, size, !options.in_air));
  }
  const Rig rig = make_rig(config::load_with_inheritance(options.rig));
  if (rig.cameras.empty()) fail_input("{}: has no cam0", options.rig.string());
  const CameraModel::Parameters& p = rig.cameras.front().model.parameters();
  return CameraModel(scaled(p, static_cast<double>(size.width) / p.width));
}

// The recording may have begun before the file was created.
std::optional<std::pair<Stamp, Stamp>> range_about(std::optional<Stamp> created, double length_s) {
  if (!created) return std::nullopt;
  return std::pair(*created - Duration::from_seconds(kCameraClockError_s + length_s),
                   *created + Duration::from_seconds(kCameraClockError_s));
}

}  // namespace

GyroAlignment align_video(const std::filesystem::path& video, const ImportOptions& options,
                          const std::optional<FieldOfView>& known, std::optional<Stamp> created,
                          const std::vector<ImuSample>& imu) {
  cv::VideoCapture capture = open_video(video, /*keep_sensor_axes=*/false);
  FrameClock clock(capture);
  PairReader reader(options);
  StatusLine status("comparing the rotation of the images with the gyro");
  while (!options.interrupted() && capture.grab()) {
    const double time = clock.next();
    if (time >= reader.end_s()) break;
    status.update(-1.0, fmt::format("{:.1f} s", time));
    reader.add(capture, time);
  }
  const std::vector<doctor::ImagePair> pairs = reader.take();
  if (pairs.empty()) return {.why_not = "its images have no corners in common"};
  const double length = capture.get(cv::CAP_PROP_FRAME_COUNT) / clock.fps();
  return align_by_gyro(pairs, camera_for(options, known, reader.size()), imu,
                       range_about(created, std::max(0.0, length)));
}

}  // namespace apvi::importer
