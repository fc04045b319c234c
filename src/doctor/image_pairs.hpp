// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/io/sequence.hpp"
#include "doctor/inertial_path.hpp"

namespace apvi::doctor {

struct PixelPair {
  Eigen::Vector2d before;  ///< [px]
  Eigen::Vector2d now;     ///< [px]
};

/// Corners that two images of one camera, some tenths of a second apart, have in common.
struct ImagePair {
  Stamp before;
  Stamp now;
  std::vector<PixelPair> points;
};

/// The pair without corners that move unlike the others: those off its fundamental matrix (RANSAC,
/// needs no calibration).
ImagePair without_outliers(const ImagePair& pair);

struct TimeSpan {
  Stamp from;
  Stamp to;
};

/// Spans of two seconds in which the body turns, at most `count`, in order of time. They are chosen
/// one after the other, each adding most to what the spans before it tell about the rotation axes
/// and about changes of the rate (greedy A-optimal design).
std::vector<TimeSpan> turning_spans(const InertialPath& path, const TimeSpan& within,
                                    std::size_t count);

/// Reads the images of the spans and follows corners through them, without use of any calibration.
/// One list for each camera; empty where the images do not have the size of the rig.
std::vector<std::vector<ImagePair>> match_images(const io::DatasetConfig& config,
                                                 const std::vector<TimeSpan>& spans,
                                                 const std::function<bool()>& interrupted);

}  // namespace apvi::doctor
