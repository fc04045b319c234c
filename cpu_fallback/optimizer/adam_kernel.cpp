// SPDX-License-Identifier: BSD-3-Clause
#include "cpu_fallback/optimizer/adam_kernel.hpp"

#include <cmath>

#include "cpu_fallback/common/clones.hpp"

namespace apvi::gaussians::cpu {
namespace {

template <typename T>
APVI_INLINE void adam_values_in(const AdamPointers<T>& p, const AdamFactors<T>& f,
                                std::int64_t begin, std::int64_t end) {
  T* __restrict__ const parameter = p.parameter;
  const T* __restrict__ const gradient = p.gradient;
  T* __restrict__ const first = p.first;
  T* __restrict__ const second = p.second;
  const AdamFactors<T> k = f;
  for (std::int64_t i = begin; i < end; ++i) {
    const T g = gradient[i];
    const T m = k.beta1 * first[i] + (T(1) - k.beta1) * g;
    const T v = k.beta2 * second[i] + (T(1) - k.beta2) * g * g;
    first[i] = m;
    second[i] = v;
    parameter[i] -= k.rate * m / (std::sqrt(v) * k.root_scale + k.epsilon);
  }
}

}  // namespace

APVI_CPU_CLONES void adam_values(const AdamPointers<float>& p, const AdamFactors<float>& f,
                                 std::int64_t begin, std::int64_t end) {
  adam_values_in(p, f, begin, end);
}
APVI_CPU_CLONES void adam_values(const AdamPointers<double>& p, const AdamFactors<double>& f,
                                 std::int64_t begin, std::int64_t end) {
  adam_values_in(p, f, begin, end);
}

}  // namespace apvi::gaussians::cpu
