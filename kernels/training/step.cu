// SPDX-License-Identifier: BSD-3-Clause
#include "kernels/training/step.hpp"

#include "kernels/common/warp.cuh"
#include "mapping/training/step_constants.hpp"

namespace apvi::mapping::cuda {
namespace {

using gaussians::cuda::block_sums;
using gaussians::cuda::kWarp;

constexpr int kThreads = 256;

unsigned blocks_for(std::int64_t count) {
  return static_cast<unsigned>((count + kThreads - 1) / kThreads);
}
__device__ std::int64_t own_index() {
  return static_cast<std::int64_t>(blockIdx.x) * kThreads + threadIdx.x;
}

/// Sums the partial sums of kStepBlocks blocks in one block; every thread gets `sums`.
template <int kValues>
__device__ void reduce_partials(const float* partials, float (&sums)[kValues]) {
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

/// One thread per pixel.
__global__ void target_kernel(TargetPointers in, float* target) {
  const auto i = static_cast<int>(own_index());
  if (i >= in.width * in.height) return;
  const int row = i / in.width;
  const int column = i - row * in.width;
  float sums[3] = {};
  for (int y = 0; y < in.reduction; ++y) {
    const std::int64_t line = static_cast<std::int64_t>(row * in.reduction + y) * in.full_width;
    const std::uint8_t* const pixels = in.image + 3 * (line + column * in.reduction);
    for (int x = 0; x < in.reduction; ++x) {
      for (int c = 0; c < 3; ++c) {
        const std::uint8_t byte = pixels[3 * x + c];
        sums[c] += in.light != nullptr ? in.light[byte] : static_cast<float>(byte);
      }
    }
  }
  float divisor = static_cast<float>(in.reduction * in.reduction);
  if (in.light == nullptr) divisor *= 255.0f;
  if (in.falloff != nullptr) divisor *= in.falloff[i];
  if (in.log_gain != nullptr) divisor *= expf(*in.log_gain);
  for (int c = 0; c < 3; ++c) target[3 * i + c] = sums[c] / divisor;
}

__device__ bool differs_from(float value, float veiling_light) {
  const float tolerance = static_cast<float>(step::kOpenWaterAbsTolerance) +
                          static_cast<float>(step::kOpenWaterRelTolerance) * veiling_light;
  return fabsf(value - veiling_light) >= tolerance;
}

__device__ bool is_saturated(float value) {
  return value >= static_cast<float>(step::kSaturated);
}

/// Statistics of the window around a pixel.
struct WindowStats {
  float mean[3];
  bool uniform;
};
__device__ WindowStats window_stats(const float* image, int width, int height, int i) {
  const int row = i / width;
  const int column = i - row * width;
  constexpr int kReach = step::kOpenWaterWindow / 2;
  float sums[3] = {};
  float squares[3] = {};
  int count = 0;
  for (int y = max(0, row - kReach); y <= min(height - 1, row + kReach); ++y) {
    for (int x = max(0, column - kReach); x <= min(width - 1, column + kReach); ++x, ++count) {
      for (int c = 0; c < 3; ++c) {
        const float value = image[3 * (y * width + x) + c];
        sums[c] += value;
        squares[c] += value * value;
      }
    }
  }
  constexpr auto kTexture2 =
      static_cast<float>(step::kOpenWaterMaxStddev * step::kOpenWaterMaxStddev);
  WindowStats window = {.mean = {}, .uniform = true};
  for (int c = 0; c < 3; ++c) {
    const float mean = sums[c] / static_cast<float>(count);
    window.mean[c] = mean;
    window.uniform =
        window.uniform && squares[c] / static_cast<float>(count) - mean * mean < kTexture2;
  }
  return window;
}

/// Whether an image shows open water: its hue and nearly its brightness at the current gain, from
/// the channels that are not saturated, at least two.
__device__ bool is_open_water(const GainPointers& in, int i, float log_gain) {
  const WindowStats window = window_stats(in.image, in.width, in.height, i);
  const float* const veiling_light = in.water + 3 * i;
  float observed = 0.0f;
  float expected = 0.0f;
  int channels = 0;
  for (int c = 0; c < 3; ++c) {
    if (is_saturated(window.mean[c])) continue;
    observed += window.mean[c];
    expected += veiling_light[c];
    ++channels;
  }
  const float factor = observed / fmaxf(expected, static_cast<float>(step::kMinDivisor));
  bool open = window.uniform && channels >= 2;
  for (int c = 0; c < 3; ++c) {
    open = open && (is_saturated(window.mean[c]) ||
                    !differs_from(window.mean[c], factor * veiling_light[c]));
  }
  const float error = logf(fmaxf(factor, static_cast<float>(step::kMinGain))) - log_gain;
  return open && fabsf(error) < static_cast<float>(step::kMaxOpenWaterLogGainError);
}

/// Whether a pixel's ray points above the horizon.
__device__ bool is_above_horizon(const GainPointers& in, int i) {
  const float x = static_cast<float>(i % in.width) + 0.5f;
  const float y = static_cast<float>(i / in.width) + 0.5f;
  return in.across * x + in.down * y + in.offset > 0.0f;
}

__global__ void gain_sums_kernel(GainPointers in, const float* log_gain) {
  __shared__ float warps[kThreads / kWarp][kGainSums];
  float sums[kGainSums] = {};
  const int pixels = in.width * in.height;
  for (auto i = static_cast<int>(own_index()); i < pixels; i += kStepBlocks * kThreads) {
    const float* const p = in.image + 3 * i;
    const bool solid = in.alpha[i] > static_cast<float>(step::kSolid);
    const bool sky = is_above_horizon(in, i);
    const bool open = (!solid || sky) && in.water != nullptr && is_open_water(in, i, *log_gain);
    if (!solid && !open) continue;
    const float* const d = (open ? in.water : in.rendered) + 3 * i;
    const float weight =
        open ? static_cast<float>(sky ? step::kSkyWeight : step::kOpenWaterWeight) : 1.0f;
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

__global__ void update_gain_kernel(GainPointers in, float* log_gain, float* bias) {
  float sums[kGainSums];
  reduce_partials(in.partials, sums);
  if (threadIdx.x != 0) return;
  const float light = sums[0];
  const float colors = sums[2];
  const auto all = static_cast<float>(3 * in.width * in.height);
  const bool usable = colors > static_cast<float>(step::kMinComparedFraction) * all &&
                      light > static_cast<float>(step::kMinMeanLight) * colors;
  if (!usable) return;
  const float gain = sums[1] / fmaxf(light, static_cast<float>(step::kMinDivisor));
  const float wanted = logf(fmaxf(gain, static_cast<float>(step::kMinGain)));
  constexpr auto kMaxError = static_cast<float>(step::kMaxLogGainBiasError);
  const float error = wanted - *log_gain - *bias;
  *log_gain +=
      in.step_size * fminf(fmaxf(error, -in.max_change), in.max_change) - in.decay * *log_gain;
  *bias += in.bias_rate * fminf(fmaxf(error, -kMaxError), kMaxError);
}

/// One thread per pixel.
__global__ void classify_water_kernel(WaterClassPointers in) {
  const auto i = static_cast<int>(own_index());
  if (i >= in.width * in.height) return;
  const WindowStats window = window_stats(in.image, in.width, in.height, i);
  bool window_differs = false;
  bool pixel_differs = false;
  for (int c = 0; c < 3; ++c) {
    const float veiling_light = in.water[3 * i + c];
    window_differs = window_differs || differs_from(window.mean[c], veiling_light);
    pixel_differs = pixel_differs || differs_from(in.image[3 * i + c], veiling_light);
  }
  in.kinds[i] = static_cast<std::int8_t>((window.uniform && !window_differs) -
                                         (window_differs && pixel_differs));
}

/// One thread per pixel.
__global__ void opacity_loss_gradient_kernel(OpacityGradientPointers in) {
  const auto i = static_cast<int>(own_index());
  if (i >= in.width * in.height) return;
  const int row = i / in.width;
  const int column = i - row * in.width;
  constexpr int kReach = step::kOpenWaterMargin;
  bool near_open = false;
  for (int y = max(0, row - kReach); y <= min(in.height - 1, row + kReach); ++y) {
    for (int x = max(0, column - kReach); x <= min(in.width - 1, column + kReach); ++x) {
      near_open = near_open || in.kinds[y * in.width + x] == 1;
    }
  }
  float gradient = 0.0f;
  if (in.kinds[i] == 1) {
    gradient = in.open;
  } else if (near_open) {
    gradient = in.edge;
  } else if (in.kinds[i] == -1) {
    gradient = in.surface * (in.alpha[i] - 1.0f);
  }
  in.gradient[i] = gradient / static_cast<float>(in.width * in.height);
}

__global__ void observe_kernel(ObservePointers in) {
  const std::int64_t i = own_index();
  if (i >= in.count) return;
  in.max_weight[i] = fmaxf(in.max_weight[i], in.weight[i]);
  if (!in.visible[i]) return;
  in.gradient_sum[i] += in.gradient[i];
  in.views[i] += 1.0f;
}

__global__ void inverse_depth_kernel(CurvaturePointers in) {
  __shared__ float warps[kThreads / kWarp][kCurvatureSums];
  float sums[kCurvatureSums] = {};
  for (auto i = static_cast<int>(own_index()); i < in.width * in.height;
       i += kStepBlocks * kThreads) {
    const float depth = in.depth[i];
    const bool solid = in.alpha[i] > static_cast<float>(step::kSolid) && depth > 0.0f;
    const float inverse =
        solid ? 1.0f / fmaxf(depth, static_cast<float>(step::kCurvatureMinDepth)) : 0.0f;
    in.inverse[i] = inverse;
    in.gray[i] = (in.image[3 * i] + in.image[3 * i + 1] + in.image[3 * i + 2]) / 3.0f;
    sums[0] += solid ? 1.0f : 0.0f;
    sums[1] += inverse;
  }
  const float sum = block_sums<kThreads>(sums, warps);
  if (threadIdx.x < kCurvatureSums) in.partials[blockIdx.x * kCurvatureSums + threadIdx.x] = sum;
}

struct Curvature {
  float value;  ///< weight times absolute second difference
  float gradient;
};
/// Weighted absolute second difference of inverse depth at three pixels `step` apart.
__device__ Curvature curvature_at(const CurvaturePointers& in, int i, int step) {
  const auto second = [i, step](const float* values) {
    return values[i - step] + values[i + step] - 2.0f * values[i];
  };
  const auto solid = [&in](int at) { return in.inverse[at] > 0.0f ? 1.0f : 0.0f; };
  const float gap = fabsf(solid(i - step) + solid(i + step) - 2.0f * solid(i));
  const float weight = expf(fabsf(second(in.gray)) / static_cast<float>(-step::kCurvatureEdge) -
                            gap / static_cast<float>(step::kCurvatureGap));
  const float curvature = second(in.inverse);
  return {weight * fabsf(curvature),
          curvature > 0.0f ? weight : (curvature < 0.0f ? -weight : 0.0f)};
}

__global__ void curvature_kernel(CurvaturePointers in) {
  __shared__ float warps[kThreads / kWarp][kCurvatureSums];
  float sums[kCurvatureSums] = {};
  const int pixels = in.width * in.height;
  for (auto i = static_cast<int>(own_index()); i < pixels; i += kStepBlocks * kThreads) {
    const int row = i / in.width;
    const int column = i - row * in.width;
    const bool inside = row >= step::kCurvatureReach && row < in.height - step::kCurvatureReach &&
                        column >= step::kCurvatureReach &&
                        column < in.width - step::kCurvatureReach;
    const Curvature down =
        inside ? curvature_at(in, i, step::kCurvatureReach * in.width) : Curvature{};
    const Curvature across = inside ? curvature_at(in, i, step::kCurvatureReach) : Curvature{};
    in.gradients[i] = down.gradient;
    in.gradients[pixels + i] = across.gradient;
    sums[0] += down.value + across.value;
  }
  const float sum = block_sums<kThreads>(sums, warps);
  float* const partials = in.partials + kStepBlocks * kCurvatureSums;
  if (threadIdx.x < kCurvatureSums) partials[blockIdx.x * kCurvatureSums + threadIdx.x] = sum;
}

__global__ void finish_curvature_kernel(CurvaturePointers in, float* loss) {
  float inverses[kCurvatureSums];
  float curvatures[kCurvatureSums];
  reduce_partials(in.partials, inverses);
  reduce_partials(in.partials + kStepBlocks * kCurvatureSums, curvatures);
  if (threadIdx.x != 0) return;
  const auto differences = static_cast<float>(2 * (in.width - 2 * step::kCurvatureReach)) *
                           static_cast<float>(in.height - 2 * step::kCurvatureReach);
  const float scale = inverses[0] / fmaxf(inverses[1], static_cast<float>(step::kMinDivisor));
  *in.factor = scale / differences;
  *loss = *in.factor * curvatures[0];
}

/// One thread per pixel: sums the five second differences that it is part of.
__global__ void curvature_backward_kernel(CurvaturePointers in, const float* grad_loss,
                                          float* gradient) {
  const auto i = static_cast<int>(own_index());
  const int pixels = in.width * in.height;
  if (i >= pixels) return;
  const int row = i / in.width;
  const int column = i - row * in.width;
  const float inverse = in.inverse[i];
  if (inverse == 0.0f || in.depth[i] < static_cast<float>(step::kCurvatureMinDepth)) {
    gradient[i] = 0.0f;
    return;
  }
  const float* const down = in.gradients;
  const float* const across = in.gradients + pixels;
  float sum = -2.0f * (down[i] + across[i]);
  if (row >= step::kCurvatureReach) sum += down[i - step::kCurvatureReach * in.width];
  if (row < in.height - step::kCurvatureReach) sum += down[i + step::kCurvatureReach * in.width];
  if (column >= step::kCurvatureReach) sum += across[i - step::kCurvatureReach];
  if (column < in.width - step::kCurvatureReach) sum += across[i + step::kCurvatureReach];
  gradient[i] = -inverse * inverse * *in.factor * *grad_loss * sum;
}

}  // namespace

cudaError_t launch_target(const TargetPointers& in, float* target, cudaStream_t stream) {
  target_kernel<<<blocks_for(in.width * in.height), kThreads, 0, stream>>>(in, target);
  return cudaGetLastError();
}

cudaError_t launch_match_gain(const GainPointers& in, float* log_gain, float* bias,
                              cudaStream_t stream) {
  gain_sums_kernel<<<kStepBlocks, kThreads, 0, stream>>>(in, log_gain);
  update_gain_kernel<<<1, kThreads, 0, stream>>>(in, log_gain, bias);
  return cudaGetLastError();
}

cudaError_t launch_classify_water(const WaterClassPointers& in, cudaStream_t stream) {
  classify_water_kernel<<<blocks_for(in.width * in.height), kThreads, 0, stream>>>(in);
  return cudaGetLastError();
}

cudaError_t launch_opacity_loss_gradient(const OpacityGradientPointers& in, cudaStream_t stream) {
  opacity_loss_gradient_kernel<<<blocks_for(in.width * in.height), kThreads, 0, stream>>>(in);
  return cudaGetLastError();
}

cudaError_t launch_observe(const ObservePointers& in, cudaStream_t stream) {
  const unsigned blocks = blocks_for(in.count);
  if (blocks == 0) return cudaSuccess;
  observe_kernel<<<blocks, kThreads, 0, stream>>>(in);
  return cudaGetLastError();
}

cudaError_t launch_depth_curvature_loss(const CurvaturePointers& in, float* loss,
                                        cudaStream_t stream) {
  inverse_depth_kernel<<<kStepBlocks, kThreads, 0, stream>>>(in);
  curvature_kernel<<<kStepBlocks, kThreads, 0, stream>>>(in);
  finish_curvature_kernel<<<1, kThreads, 0, stream>>>(in, loss);
  return cudaGetLastError();
}

cudaError_t launch_depth_curvature_loss_backward(const CurvaturePointers& in,
                                                 const float* grad_loss, float* gradient,
                                                 cudaStream_t stream) {
  curvature_backward_kernel<<<blocks_for(in.width * in.height), kThreads, 0, stream>>>(
      in, grad_loss, gradient);
  return cudaGetLastError();
}

}  // namespace apvi::mapping::cuda
