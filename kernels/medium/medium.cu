// SPDX-License-Identifier: BSD-3-Clause
#include "kernels/medium/medium.hpp"

#include <cub/block/block_reduce.cuh>

#include "gaussians/render/splat_math.hpp"

namespace apvi::medium::cuda {
namespace {

constexpr int kThreads = 256;

__device__ float ray_length(const MediumPointers& in, int i) {
  return in.ray_lengths == nullptr ? 1.0f : in.ray_lengths[i];
}

__device__ gaussians::ChannelMedium<float> medium_at(const MediumPointers& in, int channel) {
  return {in.beta_d[channel], in.beta_b[channel], in.b_inf[channel]};
}

/// One thread per pixel.
__global__ void forward_kernel(MediumPointers in, float* image) {
  const int i = static_cast<int>(blockIdx.x) * kThreads + static_cast<int>(threadIdx.x);
  if (i >= in.width * in.height) return;
  const float range = in.depth[i] * ray_length(in, i);
  const float alpha = in.alpha[i];
  gaussians::BackscatterPosition<float> place = {};
  if (in.lamp_backscatter.values != nullptr) {
    const int row = i / in.width;
    const float x = (static_cast<float>(i - row * in.width) + 0.5f) / static_cast<float>(in.width);
    const float y = (static_cast<float>(row) + 0.5f) / static_cast<float>(in.height);
    place = gaussians::backscatter_position(
        in.lamp_backscatter, x, y, gaussians::backscatter_range(in.lamp_backscatter, range, alpha));
  }
  for (int c = 0; c < 3; ++c) {
    const float seen =
        gaussians::medium_forward({in.color[3 * i + c], range, alpha}, medium_at(in, c));
    image[3 * i + c] = in.lamp_backscatter.values == nullptr
                           ? seen
                           : seen + gaussians::backscatter_at(in.lamp_backscatter, c, place);
  }
}

/// Grid-stride loop over pixels; the gradients of the medium's nine scalars are reduced per block
/// into `partials`.
__global__ void backward_kernel(MediumPointers in, const float* grad_image,
                                MediumGradientPointers out) {
  float sums[kMediumScalars] = {};
  const int stride = static_cast<int>(gridDim.x) * kThreads;
  for (int i = static_cast<int>(blockIdx.x) * kThreads + static_cast<int>(threadIdx.x);
       i < in.width * in.height; i += stride) {
    const float length = ray_length(in, i);
    float range_sum = 0.0f;
    float alpha_sum = 0.0f;
    for (int c = 0; c < 3; ++c) {
      const gaussians::ChannelPixel<float> pixel = {in.color[3 * i + c], in.depth[i] * length,
                                                    in.alpha[i]};
      const gaussians::ChannelGradient<float> g =
          gaussians::medium_backward(pixel, medium_at(in, c), grad_image[3 * i + c]);
      out.color[3 * i + c] = g.pixel.color;
      range_sum += g.pixel.range;
      alpha_sum += g.pixel.alpha;
      sums[c] += g.medium.beta_d;
      sums[3 + c] += g.medium.beta_b;
      sums[6 + c] += g.medium.b_inf;
    }
    out.depth[i] = range_sum * length;
    out.alpha[i] = alpha_sum;
  }
  if (out.partials == nullptr) return;
  using Reduce = cub::BlockReduce<float, kThreads>;
  __shared__ typename Reduce::TempStorage storage;
  for (int s = 0; s < kMediumScalars; ++s) {
    const float sum = Reduce(storage).Sum(sums[s]);
    if (threadIdx.x == 0) out.partials[s * kMediumBlocks + blockIdx.x] = sum;
    __syncthreads();  // the storage is reused
  }
}

/// One block per scalar, one thread per partial sum.
__global__ void add_up_kernel(MediumGradientPointers out) {
  using Reduce = cub::BlockReduce<float, kMediumBlocks>;
  __shared__ typename Reduce::TempStorage storage;
  const float sum = Reduce(storage).Sum(out.partials[blockIdx.x * kMediumBlocks + threadIdx.x]);
  if (threadIdx.x == 0) out.scalars[blockIdx.x] = sum;
}

/// One thread per point.
__device__ void add_irradiance(const LampPointers& in, const LampBeam& lamp, const float* point,
                               float* irradiance) {
  float square = 0.0f;
  float along = 0.0f;
  for (int k = 0; k < 3; ++k) {
    const float x = point[k] - lamp.position[k];
    square += x * x;
    along += x * lamp.axis[k];
  }
  const float distance = fmaxf(sqrtf(square), in.nearest_m);
  const float x = 1.0f - along / distance;
  const float beam = x < 1.0f ? lamp.share * expf(-x * (lamp.linear + lamp.square * x)) : 0.0f;
  const float ratio = in.unit_range_m / distance;
  for (int c = 0; c < 3; ++c) {
    irradiance[c] += beam * ratio * ratio * expf(-in.beta_d[c] * (distance - in.unit_range_m));
  }
}

__global__ void lamp_light_kernel(LampPointers in, float* light) {
  const std::int64_t i = static_cast<std::int64_t>(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= in.count) return;
  const float* const p = in.means + 3 * i;
  float point[3];
  for (int k = 0; k < 3; ++k) {
    const float* const row = in.T_camera_world + 4 * k;
    point[k] = row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3];
  }
  float irradiance[3] = {};
  for (int j = 0; j < in.lamp_count; ++j) add_irradiance(in, in.lamps[j], point, irradiance);
  for (int c = 0; c < 3; ++c) {
    light[3 * i + c] = in.daylight[c] + (1.0f - in.daylight[c]) * irradiance[c];
  }
}

}  // namespace

cudaError_t launch_medium_forward(const MediumPointers& in, float* image, cudaStream_t stream) {
  const auto blocks = static_cast<unsigned>((in.width * in.height + kThreads - 1) / kThreads);
  if (blocks == 0) return cudaSuccess;
  forward_kernel<<<blocks, kThreads, 0, stream>>>(in, image);
  return cudaGetLastError();
}

cudaError_t launch_medium_backward(const MediumPointers& in, const float* grad_image,
                                   const MediumGradientPointers& out, cudaStream_t stream) {
  backward_kernel<<<kMediumBlocks, kThreads, 0, stream>>>(in, grad_image, out);
  if (out.partials != nullptr) {
    add_up_kernel<<<kMediumScalars, kMediumBlocks, 0, stream>>>(out);
  }
  return cudaGetLastError();
}

cudaError_t launch_lamp_light(const LampPointers& in, float* light, cudaStream_t stream) {
  const auto blocks = static_cast<unsigned>((in.count + kThreads - 1) / kThreads);
  if (blocks == 0) return cudaSuccess;
  lamp_light_kernel<<<blocks, kThreads, 0, stream>>>(in, light);
  return cudaGetLastError();
}

}  // namespace apvi::medium::cuda
