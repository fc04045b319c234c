// SPDX-License-Identifier: BSD-3-Clause
#include "cpu_fallback/loss/loss_kernel.hpp"

#include <algorithm>

#include "cpu_fallback/common/clones.hpp"
#include "gaussians/metrics/ssim_math.hpp"

namespace apvi::gaussians::cpu {
namespace {

template <typename T>
APVI_INLINE void blur_along(const T* padded, std::int64_t length, T* __restrict__ out) {
  const T* const p = padded + kMargin;
  for (std::int64_t i = 0; i < length; ++i) {
    T sum = static_cast<T>(kSsimWeights[0]) * p[i];
    for (std::int64_t t = 1; t <= kSsimRadius; ++t) {
      sum +=
          static_cast<T>(kSsimWeights[static_cast<std::size_t>(t)]) * (p[i - 3 * t] + p[i + 3 * t]);
    }
    out[i] = sum;
  }
}

template <typename T>
APVI_INLINE void blur_across(const Neighbors<T>& rows, std::int64_t offset, std::int64_t length,
                             T* __restrict__ out) {
  std::array<const T*, kSsimTaps> p = {};
  for (std::size_t t = 0; t < p.size(); ++t) p[t] = rows[t] + offset;
  for (std::int64_t i = 0; i < length; ++i) {
    T sum = static_cast<T>(kSsimWeights[0]) * p[kSsimRadius][i];
    for (std::size_t t = 1; t <= kSsimRadius; ++t) {
      sum += static_cast<T>(kSsimWeights[t]) * (p[kSsimRadius - t][i] + p[kSsimRadius + t][i]);
    }
    out[i] = sum;
  }
}

/// A sum in sixteen lanes, which vectorizes and does not depend on the vector width.
template <typename T>
APVI_INLINE double sum_of(const T* values, std::int64_t length) {
  constexpr std::int64_t kLanes = 16;
  T lanes[kLanes] = {};
  std::int64_t i = 0;
  for (; i + kLanes <= length; i += kLanes) {
    for (std::int64_t j = 0; j < kLanes; ++j) lanes[j] += values[i + j];
  }
  double sum = 0.0;
  for (const T lane : lanes) sum += static_cast<double>(lane);
  for (; i < length; ++i) sum += static_cast<double>(values[i]);
  return sum;
}

template <typename T>
struct Padded {
  T* first;
  std::int64_t length;

  APVI_INLINE T* row(std::int64_t k) const { return first + k * (length + 2 * kMargin) + kMargin; }
  APVI_INLINE void clear_margins(std::int64_t rows) const {
    for (std::int64_t k = 0; k < rows; ++k) {
      std::fill_n(row(k) - kMargin, kMargin, T(0));
      std::fill_n(row(k) + length, kMargin, T(0));
    }
  }
};

template <typename T>
APVI_INLINE void blur_images_in(const LossRow<T>& row, T* scratch, T* blurred) {
  const Padded<T> padded = {scratch, row.length};
  padded.clear_margins(kBlurred);
  T* const s = padded.row(0);
  T* const d = padded.row(1);
  T* const ss = padded.row(2);
  T* const dd = padded.row(3);
  for (std::int64_t i = 0; i < row.length; ++i) {
    const T difference = row.weight[i] * (row.image[i] - row.target[i]);
    const T sum = T(2) * row.target[i] + difference;
    s[i] = sum;
    d[i] = difference;
    ss[i] = sum * sum;
    dd[i] = difference * difference;
  }
  for (std::int64_t k = 0; k < kBlurred; ++k) {
    blur_along(padded.row(k) - kMargin, row.length, blurred + k * row.length);
  }
}

template <typename T>
APVI_INLINE RowSums compare_in(const LossRow<T>& row, const Neighbors<T>& blurred, T* scratch,
                               T* derivatives) {
  const std::int64_t n = row.length;
  const Padded<T> rows = {scratch, n};
  for (std::int64_t k = 0; k < kBlurred; ++k) blur_across(blurred, k * n, n, rows.row(k));
  T* const s = rows.row(0);
  T* const d = rows.row(1);
  T* const ss = rows.row(2);
  T* const dd = rows.row(3);
  for (std::int64_t i = 0; i < n; ++i) {  // results overwrite the inputs
    const Ssim<T> ssim(s[i], d[i], ss[i], dd[i]);
    const T weight = row.weight[i];
    s[i] = weight * ssim.d_mean;
    d[i] = weight * ssim.d_ss;
    ss[i] = weight * ssim.d_dd;
    dd[i] = weight * ssim.value;
  }
  RowSums sums = {.l1 = 0.0, .ssim = sum_of(dd, n)};
  if (derivatives != nullptr) {
    rows.clear_margins(kDerivatives);
    for (std::int64_t k = 0; k < kDerivatives; ++k) {
      blur_along(rows.row(k) - kMargin, n, derivatives + k * n);
    }
  }
  for (std::int64_t i = 0; i < n; ++i) {
    const T difference = row.weight[i] * (row.image[i] - row.target[i]);
    dd[i] = difference < T(0) ? -difference : difference;
  }
  sums.l1 = sum_of(dd, n);
  return sums;
}

template <typename T>
APVI_INLINE void differentiate_in(const LossRow<T>& row, const Neighbors<T>& derivatives,
                                  const RowSums& factors, T* __restrict__ gradient) {
  constexpr std::int64_t kBlock = 192;  // fits into the L1 cache
  T d_mean[kBlock];
  T d_ss[kBlock];
  T d_dd[kBlock];
  const T l1 = static_cast<T>(factors.l1);
  const T ssim = static_cast<T>(factors.ssim);
  for (std::int64_t begin = 0; begin < row.length; begin += kBlock) {
    const std::int64_t n = std::min(kBlock, row.length - begin);
    blur_across(derivatives, begin, n, d_mean);
    blur_across(derivatives, row.length + begin, n, d_ss);
    blur_across(derivatives, 2 * row.length + begin, n, d_dd);
    for (std::int64_t j = 0; j < n; ++j) {
      const std::int64_t i = begin + j;
      const T d = row.weight[i] * (row.image[i] - row.target[i]);
      const T s = T(2) * row.target[i] + d;
      const T sign = d > T(0) ? l1 : (d < T(0) ? -l1 : T(0));
      const T d_ssim = d_mean[j] + T(2) * (s * d_ss[j] + d * d_dd[j]);
      gradient[i] = sign + ssim * row.weight[i] * d_ssim;
    }
  }
}

}  // namespace

APVI_CPU_CLONES void blur_images(const LossRow<float>& row, float* scratch, float* blurred) {
  blur_images_in(row, scratch, blurred);
}
APVI_CPU_CLONES void blur_images(const LossRow<double>& row, double* scratch, double* blurred) {
  blur_images_in(row, scratch, blurred);
}
APVI_CPU_CLONES RowSums compare(const LossRow<float>& row, const Neighbors<float>& blurred,
                                float* scratch, float* derivatives) {
  return compare_in(row, blurred, scratch, derivatives);
}
APVI_CPU_CLONES RowSums compare(const LossRow<double>& row, const Neighbors<double>& blurred,
                                double* scratch, double* derivatives) {
  return compare_in(row, blurred, scratch, derivatives);
}
APVI_CPU_CLONES void differentiate(const LossRow<float>& row, const Neighbors<float>& derivatives,
                                   const RowSums& factors, float* gradient) {
  differentiate_in(row, derivatives, factors, gradient);
}
APVI_CPU_CLONES void differentiate(const LossRow<double>& row, const Neighbors<double>& derivatives,
                                   const RowSums& factors, double* gradient) {
  differentiate_in(row, derivatives, factors, gradient);
}

}  // namespace apvi::gaussians::cpu
