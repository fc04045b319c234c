// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>

/// Photometric loss arithmetic, one image row at a time, without LibTorch.
///
/// Instead of x, y, x², y² and xy of the usual SSIM formulation, the sum and difference s = x + y
/// and d = x - y and their squares are blurred: four images instead of five, and three derivatives
/// in the backward pass. The blur is separable: along a row, then over eleven rows.
namespace apvi::gaussians::cpu {

inline constexpr std::int64_t kSsimRadius = 5;
inline constexpr std::int64_t kSsimTaps = 2 * kSsimRadius + 1;
inline constexpr std::int64_t kMargin = 3 * kSsimRadius;  ///< zeros on either side of a row
inline constexpr std::int64_t kBlurred = 4;               ///< s, d, s², d²
inline constexpr std::int64_t kDerivatives = 3;           ///< of SSIM by s and d, by s², by d²

/// A row of both images: `length` = 3 W values, interleaved RGB.
template <typename T>
struct LossRow {
  const T* image;
  const T* target;
  const T* weight;  ///< 1 for valid pixels, else 0
  std::int64_t length;
};

/// The eleven rows around a row, top to bottom.
template <typename T>
using Neighbors = std::array<const T*, kSsimTaps>;

struct RowSums {
  double l1;
  double ssim;
};

/// Scratch values that the functions below need.
constexpr std::int64_t scratch_size(std::int64_t length) {
  return kBlurred * (length + 2 * kMargin);
}

/// Blurs s, d, s² and d² along the row, into `blurred` [4,length].
void blur_images(const LossRow<float>& row, float* scratch, float* blurred);
void blur_images(const LossRow<double>& row, double* scratch, double* blurred);

/// Sums of the absolute differences and of SSIM over a row, from the blurred neighboring rows. With
/// `derivatives` [3,length], also the derivatives of SSIM, blurred along the row.
RowSums compare(const LossRow<float>& row, const Neighbors<float>& blurred, float* scratch,
                float* derivatives);
RowSums compare(const LossRow<double>& row, const Neighbors<double>& blurred, double* scratch,
                double* derivatives);

/// Derivative with respect to an image row of l1 * (sum of absolute differences) + ssim * (sum of
/// SSIM).
void differentiate(const LossRow<float>& row, const Neighbors<float>& derivatives,
                   const RowSums& factors, float* gradient);
void differentiate(const LossRow<double>& row, const Neighbors<double>& derivatives,
                   const RowSums& factors, double* gradient);

}  // namespace apvi::gaussians::cpu
