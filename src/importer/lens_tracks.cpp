// SPDX-License-Identifier: BSD-3-Clause
#include "importer/lens_tracks.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <optional>

#include "core/median.hpp"
#include "core/status_line.hpp"

namespace apvi::importer {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kParts = 10;
constexpr std::size_t kImagesPerPart = 6;
constexpr std::size_t kMaxLength = 60;  // images that a part may span
constexpr std::size_t kMinParts = 4;    // that all images allow
constexpr int kMinWidth = 640;          // of reduced images [px]
constexpr int kCorners = 150;
constexpr std::size_t kMinCorners = 40;
constexpr std::size_t kMinImages = 3;
constexpr double kMotion = 0.2;       // of the image's width
constexpr double kMinMotion = 0.025;  // the same, where corners get lost
constexpr double kMaxBackAndForth_px = 0.5;
constexpr int kFlowWindow_px = 21;
constexpr int kFlowLevels = 4;

using Points = std::vector<cv::Point2f>;

cv::Mat read_gray(const fs::path& file, int reduction) {
  const int flags = reduction == 1   ? cv::IMREAD_GRAYSCALE
                    : reduction == 2 ? cv::IMREAD_REDUCED_GRAYSCALE_2
                    : reduction == 4 ? cv::IMREAD_REDUCED_GRAYSCALE_4
                                     : cv::IMREAD_REDUCED_GRAYSCALE_8;
  return cv::imread(file.string(), flags | cv::IMREAD_IGNORE_ORIENTATION);
}

std::size_t max_length(std::size_t images) {
  return std::min(kMaxLength, images / kMinParts);
}

Points corners_of(const cv::Mat& image) {
  Points corners;
  const double distance = 0.02 * image.cols;
  cv::goodFeaturesToTrack(image, corners, kCorners, 0.01, distance);
  return corners;
}

double distance(const cv::Point2f& a, const cv::Point2f& b) {
  return std::hypot(a.x - b.x, a.y - b.y);
}

struct Flow {
  Points to;
  std::vector<unsigned char> found;
};

Flow flow(const cv::Mat& image, const cv::Mat& next, const Points& from) {
  Flow result;
  cv::Mat error;
  cv::calcOpticalFlowPyrLK(image, next, from, result.to, result.found, error,
                           {kFlowWindow_px, kFlowWindow_px}, kFlowLevels);
  return result;
}

/// Corners of a first image, followed from image to image.
class Follower {
 public:
  explicit Follower(const cv::Mat& first) : image_(first) {
    for (const cv::Point2f& corner : corners_of(first)) paths_.push_back({corner});
  }

  void follow(const cv::Mat& next) {
    if (paths_.empty()) return;
    Points from;
    for (const Points& path : paths_) from.push_back(path.back());
    const Flow there = flow(image_, next, from);
    const Flow back = flow(next, image_, there.to);
    std::vector<Points> kept;
    for (std::size_t i = 0; i < from.size(); ++i) {
      const bool found = there.found[i] != 0 && back.found[i] != 0;
      if (!found || distance(from[i], back.to[i]) > kMaxBackAndForth_px) continue;
      kept.push_back(std::move(paths_[i]));
      kept.back().push_back(there.to[i]);
    }
    paths_ = std::move(kept);
    image_ = next;
  }

  std::size_t count() const { return paths_.size(); }
  std::size_t images() const { return paths_.empty() ? 0 : paths_.front().size(); }
  // Median over the corners [px].
  double motion() const {
    std::vector<double> moved;
    for (const Points& path : paths_) moved.push_back(distance(path.front(), path.back()));
    return median(std::move(moved));
  }
  // Some images of the paths, evenly spread from first to last.
  TrackSegment segment() const {
    TrackSegment segment;
    for (const Points& path : paths_) {
      const std::size_t images = std::min(kImagesPerPart, path.size());
      auto& track = segment.tracks.emplace_back();
      for (std::size_t k = 0; k < images; ++k) {
        const cv::Point2f& p = path[k * (path.size() - 1) / (images - 1)];
        track.emplace_back(p.x, p.y);
      }
    }
    return segment;
  }

 private:
  cv::Mat image_;
  std::vector<Points> paths_;
};

bool is_enough(const Follower& corners, double motion_px) {
  return corners.images() >= kMinImages && corners.count() >= kMinCorners &&
         corners.motion() > motion_px;
}

/// A part of the images: its corners, and where it ended.
struct Part {
  std::optional<TrackSegment> segment;
  std::size_t last = 0;
};

// Until the corners have moved far enough, or few are left.
Part part_from(const std::vector<fs::path>& images, std::size_t first, int reduction) {
  const cv::Mat image = read_gray(images[first], reduction);
  if (image.empty()) return {std::nullopt, first};
  Follower corners(image);
  const std::size_t end = std::min(images.size(), first + max_length(images.size()));
  std::size_t k = first + 1;
  for (; k < end && !is_enough(corners, kMotion * image.cols); ++k) {
    const cv::Mat next = read_gray(images[k], reduction);
    if (next.size() != image.size()) break;
    Follower longer = corners;
    longer.follow(next);
    if (longer.count() < kMinCorners) break;
    corners = std::move(longer);
  }
  if (!is_enough(corners, kMinMotion * image.cols)) return {std::nullopt, k - 1};
  return {corners.segment(), k - 1};
}

int reduction_of(ImageSize size) {
  int reduction = 1;
  while (reduction < 8 && size.width / (2 * reduction) >= kMinWidth) reduction *= 2;
  return reduction;
}

}  // namespace

FollowedCorners follow_corners(const std::vector<fs::path>& images, ImageSize size,
                               const std::function<bool()>& interrupted) {
  const int reduction = reduction_of(size);
  FollowedCorners found{{size.width / reduction, size.height / reduction}, {}};
  if (max_length(images.size()) < kMinImages) return found;
  StatusLine status("looking at the lens");
  std::size_t next = 0;
  for (std::size_t part = 0; part < kParts; ++part) {
    if (interrupted()) return {found.size, {}};
    const std::size_t first = std::max(next, part * images.size() / kParts);
    if (first >= images.size()) break;
    status.update(static_cast<double>(first) / static_cast<double>(images.size()), "");
    Part followed = part_from(images, first, reduction);
    if (followed.segment) found.segments.push_back(std::move(*followed.segment));
    next = followed.last + 1;
  }
  return found;
}

}  // namespace apvi::importer
