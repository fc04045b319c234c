// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>

namespace apvi::sim {

/// How many times light is scattered on a path of the scattering depth tau, given that it is
/// scattered at all: tau / (1 - exp(-tau)).
double mean_scatterings(double tau);

/// What the blur depends on.
struct ForwardBlur {
  double focal_px = 400.0;
  double scattering = 0.0;  ///< by the small angles, of green [1/m]
};

/// Spreads `light` (CV_32FC3), the part of the direct light that was scattered by small angles, by
/// the range [m] at which it started, and adds it to `image`. n scatterings by angles of the root
/// mean square theta, at places spread evenly over the path, turn the light that arrives by
/// theta sqrt(n / 3) (Fermi and Eyges), so that the blur grows with range. The angles are those of
/// `small_angle_classes`. What leaves the image at a border is replaced by what enters there.
void add_forward_blur(const ForwardBlur& blur, const cv::Mat& light, const cv::Mat& range,
                      cv::Mat& image);

}  // namespace apvi::sim
