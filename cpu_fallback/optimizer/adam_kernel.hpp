// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

/// Adam arithmetic without LibTorch.
namespace apvi::gaussians::cpu {

template <typename T>
struct AdamPointers {
  T* parameter;
  const T* gradient;
  T* first;
  T* second;
};

/// Constants of one Adam step of one group.
template <typename T>
struct AdamFactors {
  T beta1;
  T beta2;
  T rate;        ///< learning rate / (1 - beta1^steps)
  T root_scale;  ///< 1 / sqrt(1 - beta2^steps)
  T epsilon;
};

/// Updates the values [begin, end).
void adam_values(const AdamPointers<float>& p, const AdamFactors<float>& f, std::int64_t begin,
                 std::int64_t end);
void adam_values(const AdamPointers<double>& p, const AdamFactors<double>& f, std::int64_t begin,
                 std::int64_t end);

}  // namespace apvi::gaussians::cpu
