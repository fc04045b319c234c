// SPDX-License-Identifier: BSD-3-Clause
// Backward pass of blending; repeats the forward traversal.
#include "kernels/raster/tile_walk.cuh"

namespace apvi::gaussians::cuda {
namespace {

constexpr int kBackwardBatch = 64;

/// Per-pixel state: derivatives of the loss by color, by the sum of weighted depths, by alpha; and
/// the weighted sum of the remaining splats.
struct PixelGradient {
  float color[3];
  float depth, alpha, rest;
};

__device__ PixelGradient gradient_at(const ImagePointers& image, const ImageGradientPointers& grad,
                                     std::int64_t at) {
  PixelGradient out = {};
  const float opacity = image.alpha[at];
  if (grad.alpha != nullptr) out.alpha = grad.alpha[at];
  out.rest = out.alpha * opacity;
  if (grad.depth != nullptr) {
    out.depth = opacity > 0.0f ? grad.depth[at] / opacity : 0.0f;
    out.alpha -= out.depth * image.depth[at];
  }
  for (int c = 0; c < 3; ++c) {
    out.color[c] = grad.color[3 * at + c];
    out.rest = fmaf(out.color[c], image.color[3 * at + c], out.rest);
  }
  return out;
}

/// Sums ten values over a warp: at every step each half of the lanes keeps half of the values.
/// `value_of_lane` tells which lane holds which sum.
__device__ float sum_ten(const float (&v)[kSlotFloats]) {
  const int lane = static_cast<int>(threadIdx.x) % kWarp;
  const auto swap = [lane](float low, float high, int bit) {
    const bool upper = (lane & bit) != 0;
    const float give = upper ? low : high;
    return (upper ? high : low) + __shfl_xor_sync(kAllLanes, give, bit);
  };
  float five[5];
  for (int k = 0; k < 5; ++k) five[k] = swap(v[k], v[k + 5], 16);
  const float three[3] = {swap(five[0], five[3], 8), swap(five[1], five[4], 8),
                          swap(five[2], 0.0f, 8)};
  const float two[2] = {swap(three[0], three[2], 4), swap(three[1], 0.0f, 4)};
  float one = swap(two[0], two[1], 2);
  one += __shfl_xor_sync(kAllLanes, one, 1);
  return one;
}
/// Index of the value that a lane holds after `sum_ten`; -1: none.
__device__ int value_of_lane() {
  const unsigned lane = threadIdx.x % kWarp;
  if ((lane & 1U) != 0) return -1;
  const int two = (lane & 2U) != 0 ? 1 : 0;
  int three = two;
  if ((lane & 4U) != 0) three = two == 0 ? 2 : 3;  // of three values, the fourth is padding
  if (three == 3) return -1;
  int five = three;
  if ((lane & 8U) != 0) five = three == 2 ? 5 : three + 3;
  if (five == 5) return -1;
  return (lane & 16U) != 0 ? five + 5 : five;
}

struct BackwardShared {
  Batch<kBackwardBatch> batch;
  float sums[kTileWarps][kBackwardBatch][kSlotFloats];
  unsigned long long written[kTileWarps];
};

/// Loads a batch of the splats that a chunk contributes.
__device__ void load_batch(const SplatPointers& splats, const BinPointers& bins,
                           std::uint32_t begin, int count, Batch<kBackwardBatch>& batch) {
  const auto at = static_cast<int>(threadIdx.x);
  if (at >= kBackwardBatch) return;
  batch.clear(at);
  if (at >= count) return;
  const std::uint32_t draw = bins.tile_draws[begin + at];
  batch.store(at, splats.splats[draw & ((1U << kSplatBits) - 1)], bins.tile_slots[begin + at],
              draw >> kSplatBits);
}

/// Accumulates one splat's derivatives at the pixels of a thread; returns whether it contributes to
/// any.
__device__ bool splat_backward(const SplatData& s, const AlphaSample& sample,
                               float (&transmittance)[kPixels], PixelGradient (&grad)[kPixels],
                               float (&sum)[kSlotFloats]) {
  for (float& x : sum) x = 0.0f;
  bool any = false;
#pragma unroll
  for (int p = 0; p < kPixels; ++p) {
    const BlendStep step = blend_pixel(sample, p, transmittance[p]);
    any = any || step.contributes;
    PixelGradient& g = grad[p];
    float value = fmaf(g.color[0], s.red, g.alpha);
    value = fmaf(g.color[1], s.green, value);
    value = fmaf(g.color[2], s.blue, value);
    value = fmaf(g.depth, s.z, value);
    g.rest = fmaf(-step.weight, value, g.rest);
    // By ln(alpha): weight (value - what lies behind); zero where alpha is clamped.
    const float behind = __fdividef(g.rest * step.alpha, 1.0f - step.alpha);
    const bool differentiable =
        step.contributes && sample.raw_alpha[p] <= static_cast<float>(kMaxAlpha);
    const float v = differentiable ? fmaf(step.weight, value, -behind) : 0.0f;
    for (int c = 0; c < 3; ++c) sum[c] = fmaf(step.weight, g.color[c], sum[c]);
    sum[3] = fmaf(step.weight, g.depth, sum[3]);
    sum[4] += v;
    sum[7] = fmaf(v, sample.dy[p], sum[7]);
    sum[8] = fmaf(v * sample.dy[p], sample.dy[p], sum[8]);
  }
  sum[5] = sum[4] * sample.dx;
  sum[6] = sum[5] * sample.dx;
  sum[9] = sum[7] * sample.dx;
  return any;
}

/// Sums the results of the warps for the splats of a batch, in a fixed order.
__device__ void store_batch(const BackwardShared& shared, int count, float* slot_gradient) {
  for (int k = static_cast<int>(threadIdx.x); k < count * kSlotFloats; k += kThreads) {
    const int at = k / kSlotFloats;
    const int value = k % kSlotFloats;
    float sum = 0.0f;
    for (int warp = 0; warp < kTileWarps; ++warp) {
      if ((shared.written[warp] >> at & 1U) != 0) sum += shared.sums[warp][at][value];
    }
    slot_gradient[static_cast<std::int64_t>(shared.batch.splats[at].slot) * kSlotFloats + value] =
        sum;
  }
}

/// Starting transmittance of a chunk and the remaining weighted sum, without the chunks before it.
__device__ void load_start(const Chunk& chunk, const PixelPair& pixels, const Frame& frame,
                           const ChunkPointers& chunks, float (&transmittance)[kPixels],
                           PixelGradient (&grad)[kPixels]) {
  for (int p = 0; p < kPixels; ++p) transmittance[p] = pixels.inside(frame, p) ? 1.0f : -1.0f;
  if (chunk.id == chunk.first) return;
  const std::uint32_t at = chunk.id * kThreads + threadIdx.x;
  const float2 start = chunks.start[at];
  transmittance[0] = start.x;
  transmittance[1] = start.y;
  for (int p = 0; p < kPixels; ++p) {
    const float4 before = chunks.sums[kPixels * at + p];
    PixelGradient& g = grad[p];
    g.rest -= before.x * g.color[0] + before.y * g.color[1] + before.z * g.color[2] +
              before.w * g.depth + (1.0f - transmittance[p]) * g.alpha;
  }
}

/// Sums the background gradient over the warp.
__device__ void store_background(const float (&background)[kBackgroundScalars], int tile,
                                 float* partials) {
  const int warp = static_cast<int>(threadIdx.x) / kWarp;
  for (int c = 0; c < kBackgroundScalars; ++c) {
    const float sum = warp_sum(background[c]);
    if (threadIdx.x % kWarp == 0) {
      partials[(tile * kTileWarps + warp) * kBackgroundScalars + c] = sum;
    }
  }
}

__global__ void __launch_bounds__(kThreads)
    background_backward_kernel(Frame frame, ImagePointers image, const float* grad_color,
                               float* partials) {
  const auto tile = static_cast<int>(blockIdx.x);
  const PixelPair pixels({tile % frame.tiles_x() * kTileSize, tile / frame.tiles_x() * kTileSize});
  float background[kBackgroundScalars] = {};
  for (int p = 0; p < kPixels; ++p) {
    if (!pixels.inside(frame, p)) continue;
    const std::int64_t at = pixels.index(frame, p);
    for (int c = 0; c < kBackgroundScalars; ++c) {
      background[c] += (1.0f - image.alpha[at]) * grad_color[3 * at + c];
    }
  }
  store_background(background, tile, partials);
}

__global__ void __launch_bounds__(kThreads)
    blend_backward_kernel(Frame frame, SplatPointers splats, BinPointers bins, ImagePointers image,
                          ChunkPointers chunks, ImageGradientPointers image_grad,
                          float* slot_gradient) {
  __shared__ BackwardShared shared;
  const Chunk chunk(frame, bins, splats.slot_capacity, blockIdx.x);
  if (chunk.is_empty || chunk.id > bins.last_visible_chunk[chunk.tile]) return;
  const TileOrigin tile = chunk.origin(frame);
  const PixelPair pixels(tile);
  const int warp = static_cast<int>(threadIdx.x) / kWarp;
  const int own_value = value_of_lane();
  float transmittance[kPixels];
  PixelGradient grad[kPixels] = {};
  for (int p = 0; p < kPixels; ++p) {
    if (pixels.inside(frame, p)) grad[p] = gradient_at(image, image_grad, pixels.index(frame, p));
  }
  load_start(chunk, pixels, frame, chunks, transmittance, grad);
  const std::uint32_t end = chunk.begin + bins.chunk_draw_count[chunk.id];
  for (std::uint32_t begin = chunk.begin; begin < end; begin += kBackwardBatch) {
    const int count = min(kBackwardBatch, static_cast<int>(end - begin));
    __syncthreads();
    load_batch(splats, bins, begin, count, shared.batch);
    __syncthreads();
    unsigned long long written = 0;
    for (int base = 0; base < count; base += kWarp) {
      const auto draw = [&](int at, const SplatData& s, const AlphaSample& sample) {
        float sum[kSlotFloats];
        const bool any = splat_backward(s, sample, transmittance, grad, sum);
        if (!__any_sync(kAllLanes, any)) return;
        written |= 1ULL << at;
        const float total = sum_ten(sum);
        if (own_value >= 0) shared.sums[warp][at][own_value] = total;
      };
      for_each_touching(shared.batch, base, pixels, draw);
    }
    if (threadIdx.x % kWarp == 0) shared.written[warp] = written;
    __syncthreads();
    store_batch(shared, count, slot_gradient);
  }
}

}  // namespace

cudaError_t launch_blend_backward(const Frame& frame, const SplatPointers& splats,
                                  const BinPointers& bins, const ImagePointers& image,
                                  const ChunkPointers& chunks, const ImageGradientPointers& grad,
                                  const BackwardScratch& scratch, cudaStream_t stream) {
  const unsigned blocks = chunk_capacity(splats.slot_capacity, bins.chunk_slots, frame.tiles());
  blend_backward_kernel<<<blocks, kThreads, 0, stream>>>(frame, splats, bins, image, chunks, grad,
                                                         scratch.slot_gradient);
  background_backward_kernel<<<static_cast<unsigned>(frame.tiles()), kThreads, 0, stream>>>(
      frame, image, grad.color, scratch.background_partials);
  return cudaGetLastError();
}

}  // namespace apvi::gaussians::cuda
