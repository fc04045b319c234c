// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>

/// The arithmetic of the photometric loss, one image row at a time, free of LibTorch.
///
/// Instead of x, y, x², y² and xy, as SSIM is usually written, the sums and differences s = x + y
/// and d = x - y and their squares are blurred: four images instead of five, and three derivatives
/// on the way back. The blur is separable: along a row first, then over eleven rows.
namespace apvi::splat::cpu {

inline constexpr std::int64_t kSsimRadius = 5;
inline constexpr std::int64_t kSsimTaps = 2 * kSsimRadius + 1;
inline constexpr std::int64_t kMargin = 3 * kSsimRadius;  ///< zeros on either side of a row
inline constexpr std::int64_t kBlurred = 4;               ///< s, d, s², d²
inline constexpr std::int64_t kDerivatives = 3;           ///< of SSIM by (s and d), s², d²

/// A row of both images: `length` = 3 W values, RGB by turns.
template <typename T>
struct LossRow {
  const T* image;
  const T* target;
  const T* weight;  ///< 1 where the pixel counts, else 0
  std::int64_t length;
};

/// Eleven rows around the one in question, from above to below.
template <typename T>
using Neighbours = std::array<const T*, kSsimTaps>;

struct RowSums {
  double l1;
  double ssim;
};

/// How many values of scratch the functions below need.
constexpr std::int64_t scratch_size(std::int64_t length) {
  return kBlurred * (length + 2 * kMargin);
}

/// Blurs s, d, s² and d² along the row, into `blurred` [4,length].
void blur_images(const LossRow<float>& row, float* scratch, float* blurred);
void blur_images(const LossRow<double>& row, double* scratch, double* blurred);

/// Sums of the absolute differences and of SSIM over a row, from its blurred neighbours. With
/// `derivatives` [3,length], also those of SSIM, blurred along the row.
RowSums compare(const LossRow<float>& row, const Neighbours<float>& blurred, float* scratch,
                float* derivatives);
RowSums compare(const LossRow<double>& row, const Neighbours<double>& blurred, double* scratch,
                double* derivatives);

/// Derivative by a row of the image of l1 * (sum of absolute differences) + ssim * (sum of SSIM).
void differentiate(const LossRow<float>& row, const Neighbours<float>& derivatives,
                   const RowSums& factors, float* gradient);
void differentiate(const LossRow<double>& row, const Neighbours<double>& derivatives,
                   const RowSums& factors, double* gradient);

}  // namespace apvi::splat::cpu
