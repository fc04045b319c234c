// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "doctor/image_pairs.hpp"

namespace apvi::doctor {

/// Follows corners through the images of one camera, given in order of time, and pairs images some
/// tenths of a second apart. Needs no calibration.
class ImagePairCollector {
 public:
  /// Pairs lie within one of `spans`, which are in order of time; images between them are left out.
  /// Up to about 260 images are used, but at least one every 0.1 s. `size` is that of the images,
  /// `mask` as in CameraCalibration.
  ImagePairCollector(std::vector<TimeSpan> spans, cv::Size size, const cv::Mat& mask);
  ~ImagePairCollector();
  ImagePairCollector(ImagePairCollector&&) noexcept;
  ImagePairCollector& operator=(ImagePairCollector&&) noexcept;

  /// Whether an image of that stamp is to be decoded and given to `add`.
  bool wants(Stamp stamp);
  /// An image of another size, or equal to the one before it, is left out.
  void add(const cv::Mat& image, Stamp stamp);
  bool is_complete() const { return span_ >= spans_.size(); }
  /// The pairs, at the end.
  std::vector<ImagePair> take();

 private:
  class Tracker;
  void finish_span();

  std::vector<TimeSpan> spans_;
  std::size_t span_ = 0;
  std::unique_ptr<Tracker> tracker_;
  double step_ = 0.0;
  std::optional<Stamp> last_;
  std::vector<ImagePair> pairs_;
};

}  // namespace apvi::doctor
