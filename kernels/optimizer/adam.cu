// SPDX-License-Identifier: BSD-3-Clause
#include "kernels/optimizer/moments.cuh"

namespace apvi::gaussians::cuda {
namespace {

constexpr int kThreads = 256;
constexpr std::int64_t kBlockValues = kThreads * kVector;

struct Groups {
  AdamGroupPointers group[kMaxAdamGroups];
  std::int64_t first_block[kMaxAdamGroups + 1];
  int count;
};

template <typename T>
__device__ bool aligned(const T* pointer) {
  return reinterpret_cast<std::uintptr_t>(pointer) % sizeof(Vector<T>) == 0;
}

template <typename Moment>
__device__ void step_vector(const AdamGroupPointers& a, std::int64_t begin, const AdamFactors& f,
                            const bool* visible) {
  auto* const first = static_cast<Moment*>(a.first);
  auto* const second = static_cast<Moment*>(a.second);
  const auto step = [&](std::int64_t i, float& p, float g, Moment& m, Moment& v) {
    step_value(p, g, m, v, a.rate, f, static_cast<unsigned>(i));
  };
  const bool whole = visible == nullptr && begin + kVector <= a.values && aligned(a.parameter) &&
                     aligned(a.gradient) && aligned(first) && aligned(second);
  if (!whole) {
    for (std::int64_t i = begin; i < min(begin + kVector, a.values); ++i) {
      if (visible != nullptr && !visible[i / a.width]) continue;
      step(i, a.parameter[i], a.gradient[i], first[i], second[i]);
    }
    return;
  }
  const Vector<float> g = load_vector(a.gradient + begin, kVector);
  Vector<float> p = load_vector(a.parameter + begin, kVector);
  Vector<Moment> m = load_vector(first + begin, kVector);
  Vector<Moment> v = load_vector(second + begin, kVector);
  for (int k = 0; k < kVector; ++k) step(begin + k, p.x[k], g.x[k], m.x[k], v.x[k]);
  store_vector(p, a.parameter + begin, kVector);
  store_vector(m, first + begin, kVector);
  store_vector(v, second + begin, kVector);
}

__global__ void adam_kernel(Groups groups, AdamFactors f, const bool* visible) {
  int which = 0;
  while (blockIdx.x >= groups.first_block[which + 1]) ++which;
  const AdamGroupPointers a = groups.group[which];
  const std::int64_t begin =
      (blockIdx.x - groups.first_block[which]) * kBlockValues + threadIdx.x * kVector;
  if (a.is_bf16) return step_vector<Half>(a, begin, f, visible);
  step_vector<float>(a, begin, f, visible);
}

}  // namespace

cudaError_t launch_adam(const AdamGroupPointers* groups, int count, const AdamFactors& factors,
                        const bool* visible, cudaStream_t stream) {
  Groups all = {};
  all.count = count;
  for (int k = 0; k < count; ++k) {
    all.group[k] = groups[k];
    all.first_block[k + 1] =
        all.first_block[k] + (groups[k].values + kBlockValues - 1) / kBlockValues;
  }
  const std::int64_t blocks = all.first_block[count];
  if (blocks == 0) return cudaSuccess;
  adam_kernel<<<static_cast<unsigned>(blocks), kThreads, 0, stream>>>(all, factors, visible);
  return cudaGetLastError();
}

}  // namespace apvi::gaussians::cuda
