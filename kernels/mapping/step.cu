// SPDX-License-Identifier: BSD-3-Clause
#include "step.hpp"

#include "../warp.cuh"
#include "apvi/mapping/step_constants.hpp"

namespace apvi::mapping::cuda {
namespace {

using splat::cuda::block_sums;
using splat::cuda::kWarp;

constexpr int kThreads = 256;

unsigned blocks_for(std::int64_t count) {
  return static_cast<unsigned>((count + kThreads - 1) / kThreads);
}
__device__ std::int64_t own_index() {
  return static_cast<std::int64_t>(blockIdx.x) * kThreads + threadIdx.x;
}

/// Sums that a grid of kStepBlocks left, by one block, in every thread's `sums`.
template <int kValues>
__device__ void add_up(const float* partials, float (&sums)[kValues]) {
  static_assert(kStepBlocks == kThreads);
  __shared__ float warps[kThreads / kWarp][kValues];
  __shared__ float totals[kValues];
  float own[kValues];
  for (int k = 0; k < kValues; ++k) own[k] = partials[threadIdx.x * kValues + k];
  const float total = block_sums<kThreads>(own, warps);
  if (threadIdx.x < kValues) totals[threadIdx.x] = total;
  __syncthreads();
  for (int k = 0; k < kValues; ++k) sums[k] = totals[k];
  __syncthreads();
}

/// One thread a pixel.
__global__ void target_kernel(TargetPointers in, float* target) {
  const auto i = static_cast<int>(own_index());
  if (i >= in.width * in.height) return;
  const int row = i / in.width;
  const int column = i - row * in.width;
  float sums[3] = {};
  for (int y = 0; y < in.reduction; ++y) {
    const std::int64_t line = static_cast<std::int64_t>(row * in.reduction + y) * in.full_width;
    const std::uint8_t* const pixels = in.picture + 3 * (line + column * in.reduction);
    for (int x = 0; x < in.reduction; ++x) {
      for (int c = 0; c < 3; ++c) sums[c] += static_cast<float>(pixels[3 * x + c]);
    }
  }
  float light = 255.0f * static_cast<float>(in.reduction * in.reduction);
  if (in.falloff != nullptr) light *= in.falloff[i];
  if (in.log_gain != nullptr) light *= expf(*in.log_gain);
  for (int c = 0; c < 3; ++c) target[3 * i + c] = sums[c] / light;
}

__device__ bool is_off(float value, float veil) {
  const float tolerance =
      static_cast<float>(step::kOpenOffset) + static_cast<float>(step::kOpenRelative) * veil;
  return fabsf(value - veil) >= tolerance;
}

__device__ bool is_saturated(float value) {
  return value >= static_cast<float>(step::kSaturated);
}

/// Of a square around a pixel.
struct Square {
  float mean[3];
  bool even;
};
__device__ Square square_around(const float* picture, int width, int height, int i) {
  const int row = i / width;
  const int column = i - row * width;
  constexpr int kReach = step::kOpenSquare / 2;
  float sums[3] = {};
  float squares[3] = {};
  int count = 0;
  for (int y = max(0, row - kReach); y <= min(height - 1, row + kReach); ++y) {
    for (int x = max(0, column - kReach); x <= min(width - 1, column + kReach); ++x, ++count) {
      for (int c = 0; c < 3; ++c) {
        const float value = picture[3 * (y * width + x) + c];
        sums[c] += value;
        squares[c] += value * value;
      }
    }
  }
  constexpr auto kTexture2 = static_cast<float>(step::kOpenTexture * step::kOpenTexture);
  Square square = {.mean = {}, .even = true};
  for (int c = 0; c < 3; ++c) {
    const float mean = sums[c] / static_cast<float>(count);
    square.mean[c] = mean;
    square.even = square.even && squares[c] / static_cast<float>(count) - mean * mean < kTexture2;
  }
  return square;
}

/// Whether a picture shows water there, of its hue and nearly as bright as the gain makes it, by
/// the colours that are not saturated, of which two make a hue.
__device__ bool is_open_at_gain(const GainPointers& in, int i, float log_gain) {
  const Square around = square_around(in.picture, in.width, in.height, i);
  const float* const veil = in.water + 3 * i;
  float shown = 0.0f;
  float of_veil = 0.0f;
  int tell = 0;
  for (int c = 0; c < 3; ++c) {
    if (is_saturated(around.mean[c])) continue;
    shown += around.mean[c];
    of_veil += veil[c];
    ++tell;
  }
  const float factor = shown / fmaxf(of_veil, static_cast<float>(step::kLeastDivisor));
  bool open = around.even && tell >= 2;
  for (int c = 0; c < 3; ++c) {
    open = open && (is_saturated(around.mean[c]) || !is_off(around.mean[c], factor * veil[c]));
  }
  const float off = logf(fmaxf(factor, static_cast<float>(step::kLeastGain))) - log_gain;
  return open && fabsf(off) < static_cast<float>(step::kOpenGain);
}

/// Whether a pixel looks above the horizon.
__device__ bool is_above(const GainPointers& in, int i) {
  const float x = static_cast<float>(i % in.width) + 0.5f;
  const float y = static_cast<float>(i / in.width) + 0.5f;
  return in.across * x + in.down * y + in.offset > 0.0f;
}

__global__ void gain_sums_kernel(GainPointers in, const float* log_gain) {
  __shared__ float warps[kThreads / kWarp][kGainSums];
  float sums[kGainSums] = {};
  const int pixels = in.width * in.height;
  for (auto i = static_cast<int>(own_index()); i < pixels; i += kStepBlocks * kThreads) {
    const float* const p = in.picture + 3 * i;
    const bool solid = in.alpha[i] > static_cast<float>(step::kSolid);
    const bool sky = is_above(in, i);
    const bool open = (!solid || sky) && in.water != nullptr && is_open_at_gain(in, i, *log_gain);
    if (!solid && !open) continue;
    const float* const d = (open ? in.water : in.drawn) + 3 * i;
    const float weight = open ? static_cast<float>(sky ? step::kSkySay : step::kOpenSay) : 1.0f;
    for (int c = 0; c < 3; ++c) {
      if (is_saturated(p[c])) continue;
      sums[0] += weight * d[c];
      sums[1] += weight * p[c];
      sums[2] += weight;
    }
  }
  const float sum = block_sums<kThreads>(sums, warps);
  if (threadIdx.x < kGainSums) in.partials[blockIdx.x * kGainSums + threadIdx.x] = sum;
}

__global__ void change_gain_kernel(GainPointers in, float* log_gain, float* usual) {
  float sums[kGainSums];
  add_up(in.partials, sums);
  if (threadIdx.x != 0) return;
  const float light = sums[0];
  const float colors = sums[2];
  const auto all = static_cast<float>(3 * in.width * in.height);
  const bool usable = colors > static_cast<float>(step::kLeastShare) * all &&
                      light > static_cast<float>(step::kLeastLight) * colors;
  if (!usable) return;
  const float gain = sums[1] / fmaxf(light, static_cast<float>(step::kLeastDivisor));
  const float wanted = logf(fmaxf(gain, static_cast<float>(step::kLeastGain)));
  constexpr auto kMost = static_cast<float>(step::kUsualGain);
  const float off = wanted - *log_gain - *usual;
  *log_gain += in.share * fminf(fmaxf(off, -in.most), in.most) - in.forgets * *log_gain;
  *usual += in.learns * fminf(fmaxf(off, -kMost), kMost);
}

/// One thread a pixel.
__global__ void water_kinds_kernel(WaterPointers in) {
  const auto i = static_cast<int>(own_index());
  if (i >= in.width * in.height) return;
  const Square around = square_around(in.picture, in.width, in.height, i);
  bool off_around = false;
  bool off_here = false;
  for (int c = 0; c < 3; ++c) {
    const float veil = in.water[3 * i + c];
    off_around = off_around || is_off(around.mean[c], veil);
    off_here = off_here || is_off(in.picture[3 * i + c], veil);
  }
  in.kinds[i] = static_cast<std::int8_t>((around.even && !off_around) - (off_around && off_here));
}

/// One thread a pixel.
__global__ void opacity_pull_kernel(PullPointers in) {
  const auto i = static_cast<int>(own_index());
  if (i >= in.width * in.height) return;
  const int row = i / in.width;
  const int column = i - row * in.width;
  constexpr int kReach = step::kBesideOpen;
  bool near_open = false;
  for (int y = max(0, row - kReach); y <= min(in.height - 1, row + kReach); ++y) {
    for (int x = max(0, column - kReach); x <= min(in.width - 1, column + kReach); ++x) {
      near_open = near_open || in.kinds[y * in.width + x] == 1;
    }
  }
  float of_all = 0.0f;
  if (in.kinds[i] == 1) {
    of_all = in.open;
  } else if (near_open) {
    of_all = in.edge;
  } else if (in.kinds[i] == -1) {
    of_all = in.surface * (in.alpha[i] - 1.0f);
  }
  in.pull[i] = of_all / static_cast<float>(in.width * in.height);
}

__global__ void observe_kernel(SeenPointers in) {
  const std::int64_t i = own_index();
  if (i >= in.count) return;
  in.max_weight[i] = fmaxf(in.max_weight[i], in.weight[i]);
  if (!in.visible[i]) return;
  in.gradient_sum[i] += in.pull[i];
  in.views[i] += 1.0f;
}

__global__ void invert_kernel(BendPointers in) {
  __shared__ float warps[kThreads / kWarp][kBendSums];
  float sums[kBendSums] = {};
  for (auto i = static_cast<int>(own_index()); i < in.width * in.height;
       i += kStepBlocks * kThreads) {
    const float depth = in.depth[i];
    const bool solid = in.alpha[i] > static_cast<float>(step::kSolid) && depth > 0.0f;
    const float inverse =
        solid ? 1.0f / fmaxf(depth, static_cast<float>(step::kBendNearest)) : 0.0f;
    in.inverse[i] = inverse;
    in.grey[i] = (in.picture[3 * i] + in.picture[3 * i + 1] + in.picture[3 * i + 2]) / 3.0f;
    sums[0] += solid ? 1.0f : 0.0f;
    sums[1] += inverse;
  }
  const float sum = block_sums<kThreads>(sums, warps);
  if (threadIdx.x < kBendSums) in.partials[blockIdx.x * kBendSums + threadIdx.x] = sum;
}

struct Bend {
  float value;  ///< even-ness times size
  float pull;
};
/// Of the second difference in the middle of three pixels `step` apart.
__device__ Bend bend_at(const BendPointers& in, int i, int step) {
  const auto second = [i, step](const float* of) {
    return of[i - step] + of[i + step] - 2.0f * of[i];
  };
  const auto solid = [&in](int at) { return in.inverse[at] > 0.0f ? 1.0f : 0.0f; };
  const float gap = fabsf(solid(i - step) + solid(i + step) - 2.0f * solid(i));
  const float even = expf(fabsf(second(in.grey)) / static_cast<float>(-step::kBendEdge) -
                          gap / static_cast<float>(step::kBendGap));
  const float bend = second(in.inverse);
  return {even * fabsf(bend), bend > 0.0f ? even : (bend < 0.0f ? -even : 0.0f)};
}

__global__ void bend_kernel(BendPointers in) {
  __shared__ float warps[kThreads / kWarp][kBendSums];
  float sums[kBendSums] = {};
  const int pixels = in.width * in.height;
  for (auto i = static_cast<int>(own_index()); i < pixels; i += kStepBlocks * kThreads) {
    const int row = i / in.width;
    const int column = i - row * in.width;
    const bool inside = row >= step::kBendReach && row < in.height - step::kBendReach &&
                        column >= step::kBendReach && column < in.width - step::kBendReach;
    const Bend down = inside ? bend_at(in, i, step::kBendReach * in.width) : Bend{};
    const Bend across = inside ? bend_at(in, i, step::kBendReach) : Bend{};
    in.pulls[i] = down.pull;
    in.pulls[pixels + i] = across.pull;
    sums[0] += down.value + across.value;
  }
  const float sum = block_sums<kThreads>(sums, warps);
  float* const partials = in.partials + kStepBlocks * kBendSums;
  if (threadIdx.x < kBendSums) partials[blockIdx.x * kBendSums + threadIdx.x] = sum;
}

__global__ void finish_bend_kernel(BendPointers in, float* bent) {
  float inverses[kBendSums];
  float bends[kBendSums];
  add_up(in.partials, inverses);
  add_up(in.partials + kStepBlocks * kBendSums, bends);
  if (threadIdx.x != 0) return;
  const auto differences = static_cast<float>(2 * (in.width - 2 * step::kBendReach)) *
                           static_cast<float>(in.height - 2 * step::kBendReach);
  const float scale = inverses[0] / fmaxf(inverses[1], static_cast<float>(step::kLeastDivisor));
  *in.factor = scale / differences;
  *bent = *in.factor * bends[0];
}

/// One thread a pixel: what the five second differences that it is part of say.
__global__ void bend_backward_kernel(BendPointers in, const float* by_bent, float* gradient) {
  const auto i = static_cast<int>(own_index());
  const int pixels = in.width * in.height;
  if (i >= pixels) return;
  const int row = i / in.width;
  const int column = i - row * in.width;
  const float inverse = in.inverse[i];
  if (inverse == 0.0f || in.depth[i] < static_cast<float>(step::kBendNearest)) {
    gradient[i] = 0.0f;
    return;
  }
  const float* const down = in.pulls;
  const float* const across = in.pulls + pixels;
  float sum = -2.0f * (down[i] + across[i]);
  if (row >= step::kBendReach) sum += down[i - step::kBendReach * in.width];
  if (row < in.height - step::kBendReach) sum += down[i + step::kBendReach * in.width];
  if (column >= step::kBendReach) sum += across[i - step::kBendReach];
  if (column < in.width - step::kBendReach) sum += across[i + step::kBendReach];
  gradient[i] = -inverse * inverse * *in.factor * *by_bent * sum;
}

}  // namespace

cudaError_t launch_target(const TargetPointers& in, float* target, cudaStream_t stream) {
  target_kernel<<<blocks_for(in.width * in.height), kThreads, 0, stream>>>(in, target);
  return cudaGetLastError();
}

cudaError_t launch_match_gain(const GainPointers& in, float* log_gain, float* usual,
                              cudaStream_t stream) {
  gain_sums_kernel<<<kStepBlocks, kThreads, 0, stream>>>(in, log_gain);
  change_gain_kernel<<<1, kThreads, 0, stream>>>(in, log_gain, usual);
  return cudaGetLastError();
}

cudaError_t launch_water_kinds(const WaterPointers& in, cudaStream_t stream) {
  water_kinds_kernel<<<blocks_for(in.width * in.height), kThreads, 0, stream>>>(in);
  return cudaGetLastError();
}

cudaError_t launch_opacity_pull(const PullPointers& in, cudaStream_t stream) {
  opacity_pull_kernel<<<blocks_for(in.width * in.height), kThreads, 0, stream>>>(in);
  return cudaGetLastError();
}

cudaError_t launch_observe(const SeenPointers& in, cudaStream_t stream) {
  const unsigned blocks = blocks_for(in.count);
  if (blocks == 0) return cudaSuccess;
  observe_kernel<<<blocks, kThreads, 0, stream>>>(in);
  return cudaGetLastError();
}

cudaError_t launch_bend(const BendPointers& in, float* bent, cudaStream_t stream) {
  invert_kernel<<<kStepBlocks, kThreads, 0, stream>>>(in);
  bend_kernel<<<kStepBlocks, kThreads, 0, stream>>>(in);
  finish_bend_kernel<<<1, kThreads, 0, stream>>>(in, bent);
  return cudaGetLastError();
}

cudaError_t launch_bend_backward(const BendPointers& in, const float* by_bent, float* gradient,
                                 cudaStream_t stream) {
  bend_backward_kernel<<<blocks_for(in.width * in.height), kThreads, 0, stream>>>(in, by_bent,
                                                                                  gradient);
  return cudaGetLastError();
}

}  // namespace apvi::mapping::cuda
