// SPDX-License-Identifier: BSD-3-Clause
#include "vio/corner_grid.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <set>

namespace apvi::vio {
namespace {

using Points = std::vector<cv::Point2f>;

constexpr int kBorder = 8;          // corners at the rim leave at once [px]
constexpr int kCornersPerCell = 3;  // what a cell is filled up to
constexpr double kMinStrength =
    4e-4;  // smaller eigenvalue, about an edge of 2.5 grey values a pixel

struct Corner {
  cv::Point2f pixel;
  float strength = 0.0F;
};

// The maximum of a parabola through three values, from the middle one.
float peak(float left, float middle, float right) {
  const float curvature = left - 2.0F * middle + right;
  if (curvature >= 0.0F) return 0.0F;
  return std::clamp(0.5F * (left - right) / curvature, -0.5F, 0.5F);
}

cv::Point2f refine(const cv::Mat& strength, cv::Point p) {
  cv::Point2f sub(p);
  if (p.x > 0 && p.x + 1 < strength.cols) {
    sub.x += peak(strength.at<float>(p.y, p.x - 1), strength.at<float>(p),
                  strength.at<float>(p.y, p.x + 1));
  }
  if (p.y > 0 && p.y + 1 < strength.rows) {
    sub.y += peak(strength.at<float>(p.y - 1, p.x), strength.at<float>(p),
                  strength.at<float>(p.y + 1, p.x));
  }
  return sub;
}

// The strongest corners of a cell that keep their distance from `taken` and each other.
std::vector<Corner> corners_in(const cv::Mat& image, cv::Rect cell, const Points& taken, int wanted,
                               double min_distance) {
  cv::Mat strength;
  cv::cornerMinEigenVal(image(cell), strength, 3);
  cv::Mat free = cv::Mat(strength.size(), CV_8U, cv::Scalar(255));
  const cv::Point2f origin(cell.tl());
  const int radius = static_cast<int>(std::ceil(min_distance));
  for (const cv::Point2f& p : taken) {
    cv::circle(free, cv::Point(p - origin), radius, 0, cv::FILLED);
  }
  std::vector<Corner> corners;
  while (static_cast<int>(corners.size()) < wanted) {
    double best = 0.0;
    cv::Point where;
    cv::minMaxLoc(strength, nullptr, &best, nullptr, &where, free);
    if (best < kMinStrength) break;
    corners.push_back({refine(strength, where) + origin, static_cast<float>(best)});
    cv::circle(free, where, radius, 0, cv::FILLED);
  }
  return corners;
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
    : image_(image), max_corners_(max_corners), min_distance_px_(min_distance_px) {
  // Twice as many places as corners: not every cell has texture.
  const double area = static_cast<double>(image.area()) * kCornersPerCell / (2.0 * max_corners);
  const double side = std::max(std::sqrt(area), min_distance_px);
  columns_ = cells_along(image.width, side);
  rows_ = cells_along(image.height, side);
}

cv::Rect CornerGrid::cell(int index) const {
  const int width = image_.width - 2 * kBorder;
  const int height = image_.height - 2 * kBorder;
  const int column = index % columns_;
  const int row = index / columns_;
  const cv::Point from(kBorder + column * width / columns_, kBorder + row * height / rows_);
  const cv::Point to(kBorder + (column + 1) * width / columns_,
                     kBorder + (row + 1) * height / rows_);
  return {from, to};
}

std::vector<int> CornerGrid::count_per_cell(const Points& points) const {
  std::vector<int> counts(static_cast<std::size_t>(columns_ * rows_), 0);
  for (std::size_t i = 0; i < counts.size(); ++i) {
    const cv::Rect2f area(cell(static_cast<int>(i)));
    counts[i] = static_cast<int>(std::count_if(
        points.begin(), points.end(), [&](const cv::Point2f& p) { return area.contains(p); }));
  }
  return counts;
}

Points CornerGrid::find(const cv::Mat& image, const Points& taken) const {
  if (image.cols <= 2 * kBorder + columns_ || image.rows <= 2 * kBorder + rows_) return {};
  const int room = max_corners_ - static_cast<int>(taken.size());
  if (room <= 0) return {};
  const std::vector<int> counts = count_per_cell(taken);
  std::vector<std::vector<Corner>> found(counts.size());
  cv::parallel_for_(cv::Range(0, static_cast<int>(counts.size())), [&](const cv::Range& range) {
    for (int i = range.start; i < range.end; ++i) {
      const auto k = static_cast<std::size_t>(i);
      const int wanted = kCornersPerCell - counts[k];
      if (wanted > 0) found[k] = corners_in(image, cell(i), taken, wanted, min_distance_px_);
    }
  });
  std::vector<Corner> corners;
  for (const auto& in_cell : found) corners.insert(corners.end(), in_cell.begin(), in_cell.end());
  std::stable_sort(corners.begin(), corners.end(),
                   [](const Corner& a, const Corner& b) { return a.strength > b.strength; });
  Points chosen;
  for (const Corner& corner : corners) {
    if (static_cast<int>(chosen.size()) == room) break;
    if (!near_any(corner.pixel, chosen, min_distance_px_)) chosen.push_back(corner.pixel);
  }
  return chosen;
}

double spread(const Points& points, cv::Size image) {
  constexpr int kColumns = 8;
  constexpr int kRows = 6;
  std::set<std::pair<int, int>> held;
  for (const cv::Point2f& p : points) {
    held.emplace(static_cast<int>(p.x) * kColumns / image.width,
                 static_cast<int>(p.y) * kRows / image.height);
  }
  return static_cast<double>(held.size()) / (kColumns * kRows);
}

}  // namespace apvi::vio
