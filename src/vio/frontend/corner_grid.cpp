// SPDX-License-Identifier: BSD-3-Clause
#include "vio/frontend/corner_grid.hpp"

#include <algorithm>
#include <array>
#include <bitset>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <tuple>

namespace apvi::vio {
namespace {

using Points = std::vector<cv::Point2f>;

constexpr int kBorder = 5;          // image border without corners [px at half size]
constexpr int kBlock = 4;           // block size of the peak search [px]
constexpr int kCornersPerCell = 3;  // maximum number of corners per cell
constexpr float kQuality = 0.01F;   // relative to the strongest corner of the image
constexpr float kNoise = 1.0F;      // mean squared gradient of image noise [gray²/px²]

// Gradient products of one row.
struct ProductRow {
  std::vector<float> xx, xy, yy;

  void resize(std::size_t n) {
    xx.resize(n);
    xy.resize(n);
    yy.resize(n);
  }
};

void multiply(const cv::Mat& gradient, int row, ProductRow& out) {
  constexpr float kScharr = 1.0F / 32.0F;  // normalization of the Scharr filter
  const auto* in = gradient.ptr<short>(row);
  for (std::size_t i = 0; i < out.xx.size(); ++i) {
    const float x = kScharr * static_cast<float>(in[2 * i]);
    const float y = kScharr * static_cast<float>(in[2 * i + 1]);
    out.xx[i] = x * x;
    out.xy[i] = x * y;
    out.yy[i] = y * y;
  }
}

void add(const ProductRow& a, const ProductRow& b, const ProductRow& c, ProductRow& sum) {
  for (std::size_t i = 0; i < sum.xx.size(); ++i) {
    sum.xx[i] = a.xx[i] + b.xx[i] + c.xx[i];
    sum.xy[i] = a.xy[i] + b.xy[i] + c.xy[i];
    sum.yy[i] = a.yy[i] + b.yy[i] + c.yy[i];
  }
}

// Smaller eigenvalue of the mean over 3x3 gradient products.
void smaller_eigenvalues(const ProductRow& sum, float* out) {
  for (std::size_t i = 1; i + 1 < sum.xx.size(); ++i) {
    const float a = sum.xx[i - 1] + sum.xx[i] + sum.xx[i + 1];
    const float b = sum.xy[i - 1] + sum.xy[i] + sum.xy[i + 1];
    const float c = sum.yy[i - 1] + sum.yy[i] + sum.yy[i + 1];
    out[i] = (a + c - std::sqrt((a - c) * (a - c) + 4.0F * b * b)) / 18.0F;
  }
}

// Shi-Tomasi corner strength of the given rows without the image border; product rows are reused.
void strength_of_rows(const cv::Mat& gradient, cv::Range rows, cv::Mat& strength) {
  std::array<ProductRow, 3> products;
  ProductRow sum;
  for (ProductRow& row : products) row.resize(static_cast<std::size_t>(gradient.cols));
  sum.resize(static_cast<std::size_t>(gradient.cols));
  for (int row = rows.start - 1; row <= rows.end; ++row) {
    multiply(gradient, row, products[static_cast<std::size_t>((row + 3) % 3)]);
    if (row <= rows.start) continue;
    add(products[0], products[1], products[2], sum);
    smaller_eigenvalues(sum, strength.ptr<float>(row - 1));
  }
}

void corner_strength(const cv::Mat& gradient, cv::Mat& strength) {
  constexpr int kStripes = 4;
  strength.create(gradient.size(), CV_32F);
  const int inner = gradient.rows - 2;
  cv::parallel_for_(cv::Range(0, kStripes), [&](const cv::Range& range) {
    const cv::Range rows(1 + range.start * inner / kStripes, 1 + range.end * inner / kStripes);
    if (!rows.empty()) strength_of_rows(gradient, rows, strength);
  });
}

// Offset of the maximum of a parabola through three values from the middle one.
float peak(float left, float middle, float right) {
  const float curvature = left - 2.0F * middle + right;
  if (curvature >= 0.0F) return 0.0F;
  return std::clamp(0.5F * (left - right) / curvature, -0.5F, 0.5F);
}

// Subpixel position of a peak in the full-size image; the OpenCV pyramid keeps every second pixel.
cv::Point2f refine(const cv::Mat& strength, cv::Point p) {
  const auto at = [&](int dx, int dy) { return strength.at<float>(p.y + dy, p.x + dx); };
  const float dx = peak(at(-1, 0), at(0, 0), at(1, 0));
  const float dy = peak(at(0, -1), at(0, 0), at(0, 1));
  return 2.0F * (cv::Point2f(p) + cv::Point2f(dx, dy));
}

// Column maxima over blocks of `kBlock` rows, starting at the border.
std::vector<float> largest_of_rows(const cv::Mat& strength) {
  const int blocks = (strength.rows - 2 * kBorder) / kBlock;
  const auto columns = static_cast<std::size_t>(strength.cols);
  std::vector<float> largest(static_cast<std::size_t>(blocks) * columns);
  for (int block = 0; block < blocks; ++block) {
    const int y = kBorder + block * kBlock;
    const auto* a = strength.ptr<float>(y);
    const auto* b = strength.ptr<float>(y + 1);
    const auto* c = strength.ptr<float>(y + 2);
    const auto* d = strength.ptr<float>(y + 3);
    float* out = &largest[static_cast<std::size_t>(block) * columns];
    for (std::size_t x = 1; x + 1 < columns; ++x) {  // the border has no corners
      out[x] = std::max(std::max(a[x], b[x]), std::max(c[x], d[x]));
    }
  }
  return largest;
}

cv::Point largest_in_block(const cv::Mat& strength, cv::Point corner) {
  cv::Point best = corner;
  for (int y = corner.y; y < corner.y + kBlock; ++y) {
    for (int x = corner.x; x < corner.x + kBlock; ++x) {
      if (strength.at<float>(y, x) > strength.at<float>(best)) best = {x, y};
    }
  }
  return best;
}

// True if not smaller than any neighbor.
bool is_peak(const cv::Mat& strength, cv::Point p) {
  const float value = strength.at<float>(p);
  for (int y = p.y - 1; y <= p.y + 1; ++y) {
    const auto* row = strength.ptr<float>(y) + p.x;
    if (std::max({row[-1], row[0], row[1]}) > value) return false;
  }
  return true;
}

bool near_any(const cv::Point2f& p, const Points& others, double distance) {
  const auto limit = static_cast<float>(distance * distance);
  return std::any_of(others.begin(), others.end(), [&](const cv::Point2f& o) {
    return (o.x - p.x) * (o.x - p.x) + (o.y - p.y) * (o.y - p.y) < limit;
  });
}

// The pyramid keeps every second pixel.
cv::Mat hidden_at_half_size(const cv::Mat& mask, cv::Size half) {
  if (mask.empty()) return {};
  cv::Mat small;
  cv::resize(mask, small, half, 0.0, 0.0, cv::INTER_NEAREST);
  return small == 0;
}

int cells_along(int length, double cell) {
  return std::max(1, static_cast<int>(std::lround((length - 2 * kBorder) / cell)));
}

}  // namespace

double corner_distance(cv::Size image, int max_corners) {
  constexpr double kOfSquareGrid = 0.55;
  constexpr double kIndependent_px = 25.0;  // the patches of optical flow do not overlap
  constexpr double kSmallSide_px = 320.0;   // of images that do not have enough corners so
  const double even = kOfSquareGrid * std::sqrt(static_cast<double>(image.area()) / max_corners);
  const double size = std::max(image.width, image.height) / kSmallSide_px;
  return std::max(even, kIndependent_px * std::min(1.0, size * size));
}

CornerGrid::CornerGrid(cv::Size image, int max_corners, double min_distance_px, const cv::Mat& mask)
    : half_((image.width + 1) / 2, (image.height + 1) / 2),
      hidden_(hidden_at_half_size(mask, half_)),
      max_corners_(max_corners),
      min_distance_px_(min_distance_px) {
  // Twice as many slots as corners, as not every cell has texture.
  const double area = static_cast<double>(half_.area()) * kCornersPerCell / (2.0 * max_corners);
  const double side = std::max(std::sqrt(area), 0.5 * min_distance_px);
  columns_ = cells_along(half_.width, side);
  rows_ = cells_along(half_.height, side);
}

int CornerGrid::cell_of(cv::Point p) const {
  const int width = half_.width - 2 * kBorder;
  const int height = half_.height - 2 * kBorder;
  const cv::Point inner = p - cv::Point(kBorder, kBorder);
  if (inner.x < 0 || inner.y < 0 || inner.x >= width || inner.y >= height) return -1;
  return inner.y * rows_ / height * columns_ + inner.x * columns_ / width;
}

// Peaks in cells with free slots. One per 4x4 block is enough; the maximum of four rows is computed
// first, as compilers vectorize it.
std::vector<CornerGrid::Corner> CornerGrid::peaks(const std::vector<int>& missing) const {
  const std::vector<float> largest = largest_of_rows(strength_);
  const float strongest = *std::max_element(largest.begin(), largest.end());
  const float weakest = std::max(kNoise, kQuality * strongest);
  std::vector<Corner> corners;
  const int columns = strength_.cols;
  for (int y = kBorder; y + kBlock <= half_.height - kBorder; y += kBlock) {
    const float* row = &largest[static_cast<std::size_t>((y - kBorder) / kBlock) *
                                static_cast<std::size_t>(columns)];
    for (int x = kBorder; x + kBlock <= columns - kBorder; x += kBlock) {
      if (std::max({row[x], row[x + 1], row[x + 2], row[x + 3]}) < weakest) continue;
      const cv::Point p = largest_in_block(strength_, {x, y});
      if (missing[static_cast<std::size_t>(cell_of(p))] <= 0 || !is_peak(strength_, p)) continue;
      corners.push_back({p, strength_.at<float>(p)});
    }
  }
  return corners;
}

Points CornerGrid::find(const cv::Mat& half_gradient, const Points& existing) {
  const int room = max_corners_ - static_cast<int>(existing.size());
  if (room <= 0 || half_gradient.size() != half_) return {};
  if (half_.width < 4 * kBorder || half_.height < 4 * kBorder) return {};
  corner_strength(half_gradient, strength_);
  if (!hidden_.empty()) strength_.setTo(0.0F, hidden_);
  std::vector<int> missing(static_cast<std::size_t>(columns_ * rows_), kCornersPerCell);
  for (const cv::Point2f& p : existing) {
    const int index = cell_of(0.5F * p);
    if (index >= 0) --missing[static_cast<std::size_t>(index)];
  }
  std::vector<Corner> heap = peaks(missing);
  const auto weaker = [](const Corner& a, const Corner& b) {  // positions are unique
    return std::tie(a.strength, a.pixel.y, a.pixel.x) < std::tie(b.strength, b.pixel.y, b.pixel.x);
  };
  std::make_heap(heap.begin(), heap.end(), weaker);
  Points chosen;
  while (!heap.empty() && static_cast<int>(chosen.size()) < room) {
    std::pop_heap(heap.begin(), heap.end(), weaker);
    const cv::Point pixel = heap.back().pixel;
    heap.pop_back();
    int& wanted = missing[static_cast<std::size_t>(cell_of(pixel))];
    const cv::Point2f p = refine(strength_, pixel);
    if (wanted <= 0 || near_any(p, chosen, min_distance_px_)) continue;
    if (near_any(p, existing, min_distance_px_)) continue;
    chosen.push_back(p);
    --wanted;
  }
  return chosen;
}

double spread(const Points& points, cv::Size image) {
  constexpr int kColumns = 8;
  constexpr int kRows = 6;
  std::bitset<std::size_t{kColumns} * kRows> held;
  for (const cv::Point2f& p : points) {
    const int column = std::clamp(static_cast<int>(p.x) * kColumns / image.width, 0, kColumns - 1);
    const int row = std::clamp(static_cast<int>(p.y) * kRows / image.height, 0, kRows - 1);
    held.set(static_cast<std::size_t>(row) * kColumns + static_cast<std::size_t>(column));
  }
  return static_cast<double>(held.count()) / (kColumns * kRows);
}

}  // namespace apvi::vio
