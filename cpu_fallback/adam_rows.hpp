// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

/// The arithmetic of Adam, free of LibTorch.
namespace apvi::splat::cpu {

template <typename T>
struct AdamPointers {
  T* parameter;
  const T* gradient;
  T* first;
  T* second;
};

/// What Adam's equations come to for one step of one group.
template <typename T>
struct AdamFactors {
  T keep_first;   ///< beta1
  T keep_second;  ///< beta2
  T rate;         ///< of learning, over 1 - beta1^steps
  T root_scale;   ///< 1 / sqrt(1 - beta2^steps)
  T epsilon;
};

/// Steps the values [begin, end).
void adam_values(const AdamPointers<float>& p, const AdamFactors<float>& f, std::int64_t begin,
                 std::int64_t end);
void adam_values(const AdamPointers<double>& p, const AdamFactors<double>& f, std::int64_t begin,
                 std::int64_t end);

}  // namespace apvi::splat::cpu
