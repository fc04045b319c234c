// SPDX-License-Identifier: BSD-3-Clause
#include "vio/corner_grid.hpp"

#include <algorithm>
#include <bitset>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace apvi::vio {
namespace {

using Points = std::vector<cv::Point2f>;

constexpr int kBorder = 5;          // corners at the rim leave at once [px at half the size]
constexpr int kCornersPerCell = 3;  // what a cell is filled up to
constexpr double kQuality = 0.01;   // of the strongest corner in the image
constexpr double kNoise = 1e-4;     // smaller eigenvalue of an edge of about 1 grey value a pixel

struct Corner {
  cv::Point2f pixel;  // in the image at its full size
  float strength = 0.0F;
};

// A pixel of the smaller image, in the larger one: OpenCV's pyramid keeps every second pixel.
cv::Point2f full_size(const cv::Point2f& half) {
  return 2.0F * half;
}

// Shi and Tomasi's measure. By stripes, so that OpenCV's threads share it; the filters read across
// the seams.
cv::Mat corner_strength(const cv::Mat& image) {
  constexpr int kStripes = 4;
  constexpr int kBlock = 3;
  cv::Mat strength(image.size(), CV_32F);
  cv::parallel_for_(cv::Range(0, kStripes), [&](const cv::Range& range) {
    const cv::Range rows(range.start * image.rows / kStripes, range.end * image.rows / kStripes);
    if (rows.empty()) return;
    cv::Mat stripe = strength.rowRange(rows);
    cv::cornerMinEigenVal(image.rowRange(rows), stripe, kBlock);
  });
  return strength;
}

// The maximum of a parabola through three values, from the middle one.
float peak(float left, float middle, float right) {
  const float curvature = left - 2.0F * middle + right;
  if (curvature >= 0.0F) return 0.0F;
  return std::clamp(0.5F * (left - right) / curvature, -0.5F, 0.5F);
}

// Never at the rim of the image: cells keep their distance from it.
cv::Point2f refine(const cv::Mat& strength, cv::Point p) {
  const float middle = strength.at<float>(p);
  const float dx = peak(strength.at<float>(p.y, p.x - 1), middle, strength.at<float>(p.y, p.x + 1));
  const float dy = peak(strength.at<float>(p.y - 1, p.x), middle, strength.at<float>(p.y + 1, p.x));
  return cv::Point2f(p) + cv::Point2f(dx, dy);
}

// The strongest corners of a cell that are `free`, which they then take.
void corners_in(const cv::Mat& strength, cv::Rect cell, int wanted, double weakest, int radius,
                cv::Mat& free, std::vector<Corner>& corners) {
  for (int k = 0; k < wanted; ++k) {
    double best = 0.0;
    cv::Point where;
    cv::minMaxLoc(strength(cell), nullptr, &best, nullptr, &where, free(cell));
    if (best < weakest) return;
    where += cell.tl();
    corners.push_back({full_size(refine(strength, where)), static_cast<float>(best)});
    cv::circle(free, where, radius, 0, cv::FILLED);
  }
}

bool near_any(const cv::Point2f& p, const Points& others, double distance) {
  return std::any_of(others.begin(), others.end(),
                     [&](const cv::Point2f& o) { return cv::norm(o - p) < distance; });
}

int cells_along(int length, double cell) {
  return std::max(1, static_cast<int>(std::lround((length - 2 * kBorder) / cell)));
}

}  // namespace

CornerGrid::CornerGrid(cv::Size image, int max_corners, double min_distance_px)
    : half_((image.width + 1) / 2, (image.height + 1) / 2),
      max_corners_(max_corners),
      min_distance_px_(min_distance_px) {
  // Twice as many places as corners: not every cell has texture.
  const double area = static_cast<double>(half_.area()) * kCornersPerCell / (2.0 * max_corners);
  const double side = std::max(std::sqrt(area), 0.5 * min_distance_px);
  columns_ = cells_along(half_.width, side);
  rows_ = cells_along(half_.height, side);
}

cv::Rect CornerGrid::cell(int index) const {
  const int width = half_.width - 2 * kBorder;
  const int height = half_.height - 2 * kBorder;
  const int column = index % columns_;
  const int row = index / columns_;
  const cv::Point from(kBorder + column * width / columns_, kBorder + row * height / rows_);
  const cv::Point to(kBorder + (column + 1) * width / columns_,
                     kBorder + (row + 1) * height / rows_);
  return {from, to};
}

std::vector<int> CornerGrid::missing_per_cell(const Points& taken) const {
  std::vector<int> missing(static_cast<std::size_t>(columns_ * rows_), kCornersPerCell);
  for (std::size_t i = 0; i < missing.size(); ++i) {
    const cv::Rect2f area(cell(static_cast<int>(i)));
    for (const cv::Point2f& p : taken) missing[i] -= area.contains(0.5F * p) ? 1 : 0;
  }
  return missing;
}

Points CornerGrid::find(const cv::Mat& half, const Points& taken) const {
  const int room = max_corners_ - static_cast<int>(taken.size());
  if (room <= 0 || half.size() != half_ || half.cols < 4 * kBorder || half.rows < 4 * kBorder) {
    return {};
  }
  const cv::Mat strength = corner_strength(half);
  double strongest = 0.0;
  cv::minMaxLoc(strength, nullptr, &strongest);
  const double weakest = std::max(kNoise, kQuality * strongest);
  const int radius = static_cast<int>(std::ceil(0.5 * min_distance_px_));
  cv::Mat free(half.size(), CV_8U, cv::Scalar(255));
  for (const cv::Point2f& p : taken) {
    cv::circle(free, cv::Point(0.5F * p), radius, 0, cv::FILLED);
  }
  std::vector<Corner> corners;
  const std::vector<int> missing = missing_per_cell(taken);
  for (std::size_t i = 0; i < missing.size(); ++i) {
    corners_in(strength, cell(static_cast<int>(i)), missing[i], weakest, radius, free, corners);
  }
  std::stable_sort(corners.begin(), corners.end(),
                   [](const Corner& a, const Corner& b) { return a.strength > b.strength; });
  Points chosen;
  for (const Corner& corner : corners) {
    if (static_cast<int>(chosen.size()) == room) break;
    const cv::Point2f& p = corner.pixel;
    if (near_any(p, chosen, min_distance_px_) || near_any(p, taken, min_distance_px_)) continue;
    chosen.push_back(p);
  }
  return chosen;
}

double spread(const Points& points, cv::Size image) {
  constexpr int kColumns = 8;
  constexpr int kRows = 6;
  std::bitset<kColumns * kRows> held;
  for (const cv::Point2f& p : points) {
    const int column = std::clamp(static_cast<int>(p.x) * kColumns / image.width, 0, kColumns - 1);
    const int row = std::clamp(static_cast<int>(p.y) * kRows / image.height, 0, kRows - 1);
    held.set(static_cast<std::size_t>(row * kColumns + column));
  }
  return static_cast<double>(held.count()) / (kColumns * kRows);
}

}  // namespace apvi::vio
