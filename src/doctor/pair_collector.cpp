// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/pair_collector.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/calib3d.hpp>
#include <utility>

#include "sensors/camera_mask.hpp"
#include "vio/frontend/corner_grid.hpp"
#include "vio/frontend/optical_flow.hpp"

namespace apvi::doctor {
namespace {

constexpr double kMaxImages = 260.0;    // of one camera
constexpr double kShortestStep = 0.03;  // between images [s]
constexpr double kLongestStep = 0.1;
constexpr double kRounding = 0.005;  // of stamps, against that step [s]
constexpr double kPairTime = 0.3;    // wanted between the images of a pair [s]
constexpr double kMinPairTime = 0.15;
constexpr double kMaxGap = 0.5;  // corners are not followed over longer gaps [s]
constexpr int kCorners = 150;    // in one image
constexpr std::size_t kPairCorners = 80;
constexpr std::size_t kMinPairCorners = 12;
constexpr double kMinDistance_px = 15.0;
constexpr double kMaxForwardBackward_px = 0.7;
constexpr double kMaxEpipolar_px = 2.0;

struct Corner {
  std::int64_t id = 0;
  cv::Point2f pixel;
  cv::Point2f velocity;  // [px/s]
};

struct Frame {
  Stamp stamp;
  std::vector<Corner> corners;  // by id
};

Eigen::Vector2d to_eigen(const cv::Point2f& p) {
  return {p.x, p.y};
}

ImagePair common_corners(const Frame& before, const Frame& now) {
  ImagePair pair{before.stamp, now.stamp, {}};
  auto it = now.corners.begin();
  for (const Corner& corner : before.corners) {
    while (it != now.corners.end() && it->id < corner.id) ++it;
    if (it == now.corners.end()) break;
    if (it->id == corner.id) pair.points.push_back({to_eigen(corner.pixel), to_eigen(it->pixel)});
  }
  // Every n-th, as corners of one age lie together.
  const std::size_t count = pair.points.size();
  if (count <= kPairCorners) return pair;
  std::vector<PixelPair> some;
  for (std::size_t i = 0; i < kPairCorners; ++i)
    some.push_back(pair.points[i * count / kPairCorners]);
  pair.points = std::move(some);
  return pair;
}

// Pairs each image with the earlier one nearest to kPairTime before it.
void add_pairs(const std::vector<Frame>& frames, std::vector<ImagePair>& pairs) {
  for (std::size_t j = 1; j < frames.size(); ++j) {
    const auto off = [&](std::size_t i) {
      return std::abs(seconds_between(frames[i].stamp, frames[j].stamp) - kPairTime);
    };
    std::size_t best = j - 1;
    for (std::size_t i = j - 1; i-- > 0 && off(i) < off(best);) best = i;
    if (seconds_between(frames[best].stamp, frames[j].stamp) < kMinPairTime) continue;
    ImagePair pair = without_outliers(common_corners(frames[best], frames[j]));
    if (pair.points.size() >= kMinPairCorners) pairs.push_back(std::move(pair));
  }
}

}  // namespace

// Follows corners through the images of a span.
class ImagePairCollector::Tracker {
 public:
  Tracker(cv::Size size, const cv::Mat& mask)
      : size_(size),
        mask_(reduced_mask(mask, 1, vio::kFlowWindow / 2)),
        preparer_(true),
        grid_(size, kCorners, kMinDistance_px, mask_) {}

  void clear() { frames_.clear(); }
  const std::vector<Frame>& frames() const { return frames_; }

  void add(const cv::Mat& image, Stamp stamp) {
    if (!vio::FramePreparer::load(image, size_, current_)) return;
    if (!frames_.empty() && vio::identical(current_.gray, last_.gray)) return;
    preparer_.build_pyramid(current_);
    Frame frame{stamp, {}};
    if (!frames_.empty() && seconds_between(frames_.back().stamp, stamp) < kMaxGap)
      frame.corners = followed(frames_.back(), stamp);
    add_new(frame);
    frames_.push_back(std::move(frame));
    std::swap(last_, current_);
  }

 private:
  std::vector<Corner> followed(const Frame& before, Stamp stamp) const {
    const auto dt = static_cast<float>(seconds_between(before.stamp, stamp));
    std::vector<cv::Point2f> from;
    std::vector<cv::Point2f> guess;
    for (const Corner& corner : before.corners) {
      from.push_back(corner.pixel);
      guess.push_back(corner.pixel + dt * corner.velocity);
    }
    const vio::Flow flow =
        vio::compute_flow(last_, current_, from, guess, from, kMaxForwardBackward_px);
    std::vector<Corner> corners;
    for (std::size_t i = 0; i < flow.to.size(); ++i) {
      if (flow.found[i] == 0 || is_hidden(mask_, flow.to[i])) continue;
      corners.push_back({before.corners[i].id, flow.to[i], (flow.to[i] - from[i]) / dt});
    }
    return corners;
  }

  void add_new(Frame& frame) {
    std::vector<cv::Point2f> pixels;
    for (const Corner& corner : frame.corners) pixels.push_back(corner.pixel);
    for (const cv::Point2f& pixel : grid_.find(current_.half_gradient(), pixels)) {
      frame.corners.push_back({next_id_++, pixel, {}});
    }
  }

  cv::Size size_;
  cv::Mat mask_;
  vio::FramePreparer preparer_;
  vio::CornerGrid grid_;
  vio::FrameImage last_;
  vio::FrameImage current_;
  std::vector<Frame> frames_;
  std::int64_t next_id_ = 0;
};

ImagePairCollector::ImagePairCollector(std::vector<TimeSpan> spans, cv::Size size,
                                       const cv::Mat& mask)
    : spans_(std::move(spans)), tracker_(std::make_unique<Tracker>(size, mask)) {
  double total = 0.0;
  for (const TimeSpan& span : spans_) total += seconds_between(span.from, span.to);
  step_ = std::clamp(total / kMaxImages, kShortestStep, kLongestStep);
}

ImagePairCollector::~ImagePairCollector() = default;
ImagePairCollector::ImagePairCollector(ImagePairCollector&&) noexcept = default;
ImagePairCollector& ImagePairCollector::operator=(ImagePairCollector&&) noexcept = default;

bool ImagePairCollector::wants(Stamp stamp) {
  while (span_ < spans_.size() && !(stamp < spans_[span_].to)) finish_span();
  if (span_ >= spans_.size() || stamp < spans_[span_].from) return false;
  return !last_ || seconds_between(*last_, stamp) >= step_ - kRounding;
}

void ImagePairCollector::add(const cv::Mat& image, Stamp stamp) {
  last_ = stamp;
  tracker_->add(image, stamp);
}

std::vector<ImagePair> ImagePairCollector::take() {
  if (!is_complete()) finish_span();
  return std::move(pairs_);
}

void ImagePairCollector::finish_span() {
  add_pairs(tracker_->frames(), pairs_);
  tracker_->clear();
  ++span_;
}

ImagePair without_outliers(const ImagePair& pair) {
  ImagePair kept{pair.before, pair.now, {}};
  if (pair.points.size() < kMinPairCorners) return kept;
  std::vector<cv::Point2d> before;
  std::vector<cv::Point2d> now;
  for (const PixelPair& point : pair.points) {
    before.emplace_back(point.before.x(), point.before.y());
    now.emplace_back(point.now.x(), point.now.y());
  }
  std::vector<uchar> inlier;
  cv::findFundamentalMat(before, now, cv::FM_RANSAC, kMaxEpipolar_px, 0.99, inlier);
  for (std::size_t i = 0; i < inlier.size(); ++i) {
    if (inlier[i] != 0) kept.points.push_back(pair.points[i]);
  }
  return kept;
}

}  // namespace apvi::doctor
