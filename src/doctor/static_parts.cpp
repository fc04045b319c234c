// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/static_parts.hpp"

#include <algorithm>
#include <cmath>
#include <exception>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "core/median.hpp"
#include "io/recorded_images.hpp"
#include "sensors/reduced_camera.hpp"
#include "vio/frontend/frame_image.hpp"

namespace apvi::doctor {
namespace {

constexpr int kMaxSide_px = 640;
constexpr double kNoise = 3.0;          // weaker gradients count less [gray levels/px]
constexpr double kMinCoherence = 0.75;  // mean length of the gradient's direction on a static edge
constexpr int kMinEdge_px = 15;         // fewer connected static pixels are chance
constexpr int kGap_px = 7;              // in an edge that is closed
constexpr double kStill = 0.35;         // change of a still region, against the median
constexpr int kMinStill_px = 50;        // smaller ones are chance
constexpr double kMinOriented = 0.6;    // of an outline that keeps its orientation
constexpr double kMinOutline = 0.6;     // part of a still region's outline that does
constexpr double kLittleContrast = 0.05;  // contrast that counts as none
constexpr double kMaxChange = 0.5;        // of an enclosed region, against that of the scene
constexpr double kMinContrast = 1.0;      // standard deviation of an image that shows something
constexpr int kTiny_px = 40;              // side of an image without noise and detail
constexpr double kMinStep = 1.0;          // mean difference of two of them [gray levels]
constexpr int kMargin_px = 3;             // around what is static

cv::Mat square(int radius) {
  return cv::Mat::ones(2 * radius + 1, 2 * radius + 1, CV_8U);
}

cv::Mat length_of(const cv::Mat& vectors) {
  std::vector<cv::Mat> parts;
  cv::split(vectors, parts);
  cv::Mat length;
  cv::magnitude(parts[0], parts[1], length);
  return length;
}

// Removes connected parts of fewer pixels.
void remove_small(cv::Mat& mask, int pixels) {
  cv::Mat labels;
  cv::Mat stats;
  cv::Mat centroids;
  const int count = cv::connectedComponentsWithStats(mask, labels, stats, centroids);
  for (int i = 1; i < count; ++i) {
    if (stats.at<int>(i, cv::CC_STAT_AREA) < pixels) mask.setTo(0, labels == i);
  }
}

double median(const cv::Mat& values, const cv::Mat& where) {
  std::vector<float> chosen;
  for (int row = 0; row < values.rows; ++row) {
    for (int column = 0; column < values.cols; ++column) {
      if (where.at<unsigned char>(row, column) != 0)
        chosen.push_back(values.at<float>(row, column));
    }
  }
  return apvi::median(std::move(chosen));
}

// Adds regions that hardly change within a static outline.
void add_still_regions(cv::Mat& hidden, const cv::Mat& change, const cv::Mat& outlines) {
  const double usual = median(change, cv::Mat(change.size(), CV_8U, cv::Scalar(255)));
  cv::Mat labels;
  cv::Mat stats;
  cv::Mat centroids;
  const int count =
      cv::connectedComponentsWithStats(change < kStill * usual, labels, stats, centroids);
  for (int i = 1; i < count; ++i) {
    if (stats.at<int>(i, cv::CC_STAT_AREA) < kMinStill_px) continue;
    const cv::Mat region = labels == i;
    cv::Mat outer;
    cv::Mat inner;
    cv::dilate(region, outer, square(1));
    cv::erode(region, inner, square(1));
    const cv::Mat outline = outer - inner;
    const int oriented = cv::countNonZero(outline & outlines);
    if (oriented > kMinOutline * cv::countNonZero(outline)) hidden.setTo(255, region);
  }
}

// Adds the regions that the edges enclose and in which brightness changes little. The largest
// region is the scene.
void fill_regions(cv::Mat& hidden, const cv::Mat& change) {
  cv::Mat labels;
  cv::Mat stats;
  cv::Mat centroids;
  const int count = cv::connectedComponentsWithStats(hidden == 0, labels, stats, centroids, 4);
  int scene = 1;
  for (int i = 2; i < count; ++i) {
    if (stats.at<int>(i, cv::CC_STAT_AREA) > stats.at<int>(scene, cv::CC_STAT_AREA)) scene = i;
  }
  const double usual = median(change, labels == scene);
  for (int i = 1; i < count; ++i) {
    if (i == scene || median(change, labels == i) > kMaxChange * usual) continue;
    hidden.setTo(255, labels == i);
  }
}

// An empty image if it is damaged.
cv::Mat decoded(const ImageFrame& image) {
  try {
    return image.decode();
  } catch (const std::exception&) {
    return {};
  }
}

}  // namespace

StaticParts::StaticParts(cv::Size size)
    : size_(size),
      by_(std::max(1, (std::max(size.width, size.height) + kMaxSide_px - 1) / kMaxSide_px)) {
  const cv::Size small(size.width / by_, size.height / by_);
  directions_ = cv::Mat::zeros(small, CV_32FC2);
  orientations_ = cv::Mat::zeros(small, CV_32FC2);
  contrast_ = cv::Mat::zeros(small, CV_32F);
  brightness_ = cv::Mat::zeros(small, CV_32F);
  brightness_2_ = cv::Mat::zeros(small, CV_32F);
}

void StaticParts::add(const cv::Mat& image) {
  cv::Mat gray;
  if (image.size() != size_ || !vio::to_gray(reduced(image, by_), gray)) return;
  gray.convertTo(gray, CV_32F);
  if (!is_new(gray)) return;
  constexpr double kPerPixel = 1.0 / 32.0;  // normalization of the Scharr filter
  cv::Mat x;
  cv::Mat y;
  cv::Scharr(gray, x, CV_32F, 1, 0, kPerPixel);
  cv::Scharr(gray, y, CV_32F, 0, 1, kPerPixel);
  cv::Mat length;
  cv::sqrt(x.mul(x) + y.mul(y) + kNoise * kNoise, length);
  x /= length;
  y /= length;
  cv::Mat vectors;
  cv::merge(std::vector<cv::Mat>{x, y}, vectors);
  directions_ += vectors;
  cv::merge(std::vector<cv::Mat>{x.mul(x) - y.mul(y), 2.0 * x.mul(y)}, vectors);
  orientations_ += vectors;
  contrast_ += x.mul(x) + y.mul(y);
  brightness_ += gray;
  brightness_2_ += gray.mul(gray);
  ++images_;
}

// Else a vehicle that stands still would make all of its view static.
bool StaticParts::is_new(const cv::Mat& gray) {
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(gray, mean, deviation);
  if (deviation[0] < kMinContrast) return false;
  cv::Mat tiny;
  cv::resize(gray, tiny, {kTiny_px, kTiny_px}, 0.0, 0.0, cv::INTER_AREA);
  const double size = static_cast<double>(tiny.total());
  if (!last_.empty() && cv::norm(tiny, last_, cv::NORM_L1) / size < kMinStep) return false;
  last_ = tiny;
  return true;
}

cv::Mat StaticParts::static_edges() const {
  cv::Mat edges = length_of(directions_) > kMinCoherence * images_;
  remove_small(edges, kMinEdge_px);
  return edges;
}

// Pixels near an edge that keeps its orientation. At the image's border gradients have no x or y.
cv::Mat StaticParts::outlines() const {
  cv::Mat oriented =
      length_of(orientations_) > kMinOriented * (contrast_ + kLittleContrast * images_);
  cv::rectangle(oriented, {0, 0}, {oriented.cols - 1, oriented.rows - 1}, cv::Scalar(0));
  cv::dilate(oriented, oriented, square(1));
  return oriented;
}

cv::Mat StaticParts::mask() const {
  cv::Mat hidden = cv::Mat::zeros(brightness_.size(), CV_8U);
  if (images_ >= kMinImages) {
    cv::morphologyEx(static_edges(), hidden, cv::MORPH_CLOSE, square(kGap_px));
    const cv::Mat mean = brightness_ / images_;
    cv::Mat change;
    cv::sqrt(cv::max(brightness_2_ / images_ - mean.mul(mean), 0.0), change);
    add_still_regions(hidden, change, outlines());
    fill_regions(hidden, change);
    cv::dilate(hidden, hidden, square(kMargin_px));
  }
  cv::Mat whole;
  cv::resize(hidden == 0, whole, {hidden.cols * by_, hidden.rows * by_}, 0.0, 0.0,
             cv::INTER_NEAREST);
  cv::copyMakeBorder(whole, whole, 0, size_.height - whole.rows, 0, size_.width - whole.cols,
                     cv::BORDER_REPLICATE);
  return whole;
}

double StaticParts::share() const {
  const cv::Mat whole = mask();
  return 1.0 - static_cast<double>(cv::countNonZero(whole)) / static_cast<double>(whole.total());
}

cv::Mat StaticParts::mean_image() const {
  cv::Mat mean;
  brightness_.convertTo(mean, CV_8U, images_ > 0 ? 1.0 / images_ : 0.0);
  cv::resize(mean, mean, size_, 0.0, 0.0, cv::INTER_LINEAR);
  return mean;
}

std::optional<StaticParts> find_static_parts(const io::DatasetConfig& config,
                                             const StaticSearch& search) {
  const auto continues = [&search] { return !search.interrupted || !search.interrupted(); };
  std::size_t count = 0;
  io::for_each_image(*io::open_sequence(config, {"camera"}), search.camera,
                     [&](const ImageFrame&) { return ++count > 0 && continues(); });
  const std::size_t every = 1 + count / (search.images + 1);
  std::size_t number = 0;
  std::optional<StaticParts> parts;
  const auto reader = io::open_sequence(config, {"camera"});
  io::for_each_image(*reader, search.camera, [&](const ImageFrame& frame) {
    if (number++ % every != 0) return true;
    const cv::Mat image = decoded(frame);
    if (!parts && !image.empty()) parts.emplace(image.size());
    if (parts) parts->add(image);
    if (search.progress) search.progress(static_cast<double>(number) / static_cast<double>(count));
    return continues();
  });
  return parts;
}

}  // namespace apvi::doctor
