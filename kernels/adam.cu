// SPDX-License-Identifier: BSD-3-Clause
#include "adam.hpp"

namespace apvi::splat::cuda {
namespace {

constexpr int kThreads = 256;
constexpr int kVector = 4;  // values that a thread moves at once
constexpr std::int64_t kBlockValues = kThreads * kVector;

struct Groups {
  AdamGroupPointers group[kMaxAdamGroups];
  std::int64_t first_block[kMaxAdamGroups + 1];
  int count;
};

__device__ void step_one(float& parameter, float g, float& m, float& v, float rate,
                         const AdamFactors& f) {
  m = f.keep_first * m + (1.0f - f.keep_first) * g;
  v = f.keep_second * v + (1.0f - f.keep_second) * g * g;
  parameter -= rate * m / (sqrtf(v) * f.root_scale + f.epsilon);
}

__device__ void step_four(const AdamGroupPointers& a, std::int64_t i, const AdamFactors& f) {
  auto& parameter = *reinterpret_cast<float4*>(a.parameter + i);
  auto& first = *reinterpret_cast<float4*>(a.first + i);
  auto& second = *reinterpret_cast<float4*>(a.second + i);
  const float4 g = *reinterpret_cast<const float4*>(a.gradient + i);
  float4 p = parameter;
  float4 m = first;
  float4 v = second;
  step_one(p.x, g.x, m.x, v.x, a.rate, f);
  step_one(p.y, g.y, m.y, v.y, a.rate, f);
  step_one(p.z, g.z, m.z, v.z, a.rate, f);
  step_one(p.w, g.w, m.w, v.w, a.rate, f);
  parameter = p;
  first = m;
  second = v;
}

__device__ bool aligned(const void* pointer) {
  return reinterpret_cast<std::uintptr_t>(pointer) % sizeof(float4) == 0;
}

__global__ void adam_kernel(Groups groups, AdamFactors f, const bool* visible) {
  int which = 0;
  while (blockIdx.x >= groups.first_block[which + 1]) ++which;
  const AdamGroupPointers a = groups.group[which];
  const std::int64_t begin =
      (blockIdx.x - groups.first_block[which]) * kBlockValues + threadIdx.x * kVector;
  const bool four = visible == nullptr && begin + kVector <= a.values && aligned(a.parameter) &&
                    aligned(a.gradient) && aligned(a.first) && aligned(a.second);
  if (four) return step_four(a, begin, f);
  for (std::int64_t i = begin; i < min(begin + kVector, a.values); ++i) {
    if (visible != nullptr && !visible[i / a.width]) continue;
    step_one(a.parameter[i], a.gradient[i], a.first[i], a.second[i], a.rate, f);
  }
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

}  // namespace apvi::splat::cuda
