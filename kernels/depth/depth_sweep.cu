// SPDX-License-Identifier: BSD-3-Clause
#include <cfloat>

#include "kernels/depth/depth.hpp"

namespace apvi::depth::cuda {
namespace {

constexpr int kThreads = 128;
constexpr int kMaxPoints = 8;   // per thread block, with few hypotheses each
constexpr int kSamples = 32;    // per patch: 6 x 6 pixels without the corners
constexpr float kReach = 2.5f;  // [px] from the center to the outermost samples
constexpr float kIntensityScale = 255.0f * 256.0f;
constexpr float kMaxStep2 = 1.25f * 1.25f;  // [px²] between adjacent hypotheses in an image
constexpr float kDifferenceLimit = 32.0f * 256.0f;  // of the mean absolute difference
constexpr float kMinDepthFactor = 1e-6f;
constexpr int kTypicalCount = 5;  // averaged images: half of the 9 neighbors of a 10-view window
constexpr int kDefaultCount = 9;  // all 9 neighbors

struct PatchTransform {
  float x, y;
  float xx, xy, yx, yy;
};

/// A reference patch in one pyramid level.
struct Patch {
  float values[kSamples];   ///< minus the mean
  float weights[kSamples];  ///< with mean 1
  float mean;
  float inverse_norm;
  float dx, dy;  ///< [px] at full resolution: shift that keeps the patch inside the image
};

/// Offset of sample k from the center.
__device__ float2 sample_place(int k) {
  // Rows of 4, 6, 6, 6, 6 and 4 samples.
  const int row = k < 4 ? 0 : k < 28 ? 1 + (k - 4) / 6 : 5;
  const int column = k < 4 ? 1 + k : k < 28 ? (k - 4) % 6 : k - 27;
  return {static_cast<float>(column) - kReach, static_cast<float>(row) - kReach};
}

__device__ float sample_bilinear(const PyramidLevel& level, const PatchTransform& p, float2 at) {
  const float x = p.x + p.xx * at.x + p.xy * at.y;
  const float y = p.y + p.yx * at.x + p.yy * at.y;
  const int column = static_cast<int>(x);
  const int row = static_cast<int>(y);
  const float right = x - static_cast<float>(column);
  const float down = y - static_cast<float>(row);
  const std::uint32_t* const word = level.pairs + row * level.width + column;
  const std::uint32_t a = __ldg(word);
  const std::uint32_t b = __ldg(word + 1);
  const auto a0 = static_cast<float>(a & 0xFFFFu);
  const auto a1 = static_cast<float>(a >> 16u);
  const auto b0 = static_cast<float>(b & 0xFFFFu);
  const auto b1 = static_cast<float>(b >> 16u);
  const float above = a0 + right * (b0 - a0);
  const float below = a1 + right * (b1 - a1);
  return above + down * (below - above);
}

__device__ bool inside(const PyramidLevel& level, const PatchTransform& p) {
  const float reach_x = kReach * (fabsf(p.xx) + fabsf(p.xy));
  const float reach_y = kReach * (fabsf(p.yx) + fabsf(p.yy));
  return p.x - reach_x >= 0.0f && p.y - reach_y >= 0.0f &&
         p.x + reach_x < static_cast<float>(level.width - 1) &&
         p.y + reach_y < static_cast<float>(level.height - 1);
}

__device__ float warp_sum(float value) {
  for (int lane = 16; lane > 0; lane /= 2) value += __shfl_xor_sync(0xFFFFFFFFu, value, lane);
  return value;
}

/// One warp, one sample per lane.
__device__ void sample_patch(const PyramidLevel& level, int index, float x, float y, float noise,
                             float sigma, Patch& patch) {
  const float scale = 1.0f / static_cast<float>(1 << index);
  const float px = scale * x - 0.5f;
  const float py = scale * y - 0.5f;
  constexpr float kEdge = kReach + 0.01f;
  const float moved_x = fminf(fmaxf(px, kEdge), static_cast<float>(level.width - 1) - kEdge);
  const float moved_y = fminf(fmaxf(py, kEdge), static_cast<float>(level.height - 1) - kEdge);
  const int lane = static_cast<int>(threadIdx.x) % kSamples;
  const float sample =
      sample_bilinear(level, {moved_x, moved_y, 1.0f, 0.0f, 0.0f, 1.0f}, sample_place(lane));
  const bool in_middle = lane == 12 || lane == 13 || lane == 18 || lane == 19;
  const float middle = 0.25f * warp_sum(in_middle ? sample : 0.0f);
  const float plain = warp_sum(sample) / kSamples;
  const float variance = warp_sum((sample - plain) * (sample - plain)) / kSamples;
  const float unit = fmaxf(sigma, sqrtf(variance));
  const float likeness = expf(-fabsf(sample - middle) / unit);
  const float weight = likeness * kSamples / warp_sum(likeness);
  const float mean = warp_sum(weight * sample) / kSamples;
  const float value = sample - mean;
  const float squares = warp_sum(weight * value * value);
  patch.values[lane] = value;
  patch.weights[lane] = weight;
  if (lane != 0) return;
  patch.mean = mean;
  patch.inverse_norm = 1.0f / sqrtf(squares + kSamples * noise * noise);
  patch.dx = (moved_x - px) / scale;
  patch.dy = (moved_y - py) / scale;
}

/// Epipolar line of a point in another image, parametrized by inverse depth.
struct EpipolarLine {
  float at_infinity[3], translation[3], by_x[3], by_y[3];

  __device__ EpipolarLine(const float* P, float x, float y) {
    for (int i = 0; i < 3; ++i, P += 4) {
      at_infinity[i] = P[0] * x + P[1] * y + P[2];
      translation[i] = P[3];
      by_x[i] = P[0];
      by_y[i] = P[1];
    }
  }
  __device__ float depth_factor(float w) const { return at_infinity[2] + w * translation[2]; }

  __device__ float2 pixel(float w) const {
    const float inverse_z = 1.0f / depth_factor(w);
    return {(at_infinity[0] + w * translation[0]) * inverse_z,
            (at_infinity[1] + w * translation[1]) * inverse_z};
  }

  __device__ PatchTransform at(float w, float2 slope) const {
    const float inverse_z = 1.0f / depth_factor(w);
    const float2 place = pixel(w);
    const auto derivative = [&](const float* by, float along, int i, float p) {
      const float top = by[i] + w * along * translation[i];
      const float bottom = by[2] + w * along * translation[2];
      return (top - p * bottom) * inverse_z;
    };
    return {place.x,
            place.y,
            derivative(by_x, slope.x, 0, place.x),
            derivative(by_y, slope.y, 0, place.x),
            derivative(by_x, slope.x, 1, place.y),
            derivative(by_y, slope.y, 1, place.y)};
  }
};

__device__ float correlation_cost(const Patch& patch, const PyramidLevel& level,
                                  const PatchTransform& place, float noise) {
  float sum = 0.0f;
  float squares = 0.0f;
  float products = 0.0f;
#pragma unroll
  for (int k = 0; k < kSamples; ++k) {
    const float value = sample_bilinear(level, place, sample_place(k)) - patch.mean;
    const float weighted = patch.weights[k] * value;
    sum += weighted;
    squares += weighted * value;
    products += weighted * patch.values[k];
  }
  const float spread = fmaxf(squares - sum * sum / kSamples, 0.0f);
  const float correlation =
      products * patch.inverse_norm / sqrtf(spread + kSamples * noise * noise);
  return correlation > 0.0f ? 1.0f - correlation : 1.0f;
}

__device__ float difference_cost(const Patch& patch, const PyramidLevel& level,
                                 const PatchTransform& place, float gain, float offset) {
  const float mean = gain * patch.mean + offset;
  float sum = 0.0f;
#pragma unroll
  for (int k = 0; k < kSamples; ++k) {
    const float sample = sample_bilinear(level, place, sample_place(k));
    sum += patch.weights[k] * fabsf(sample - mean - gain * patch.values[k]);
  }
  return sum / kSamples;
}

/// Affine intensity change from the reference to another camera through the medium: gain *
/// intensity + offset.
__device__ float2 medium_transfer(const SweepPointers& in, float2 point, int view, float w) {
  if (in.beta_d == 0.0 && in.beta_b == 0.0) return {1.0f, 0.0f};
  double here = 0.0;
  double there = 0.0;
  for (int i = 0; i < 3; ++i) {
    const double ray = static_cast<double>(in.rays[3 * i] * point.x + in.rays[3 * i + 1] * point.y +
                                           in.rays[3 * i + 2]) /
                       static_cast<double>(w);
    const double from_there = ray - static_cast<double>(in.centers[3 * view + i]);
    here += ray * ray;
    there += from_there * from_there;
  }
  here = sqrt(here);
  there = sqrt(there);
  const double gain = exp(in.beta_d * (here - there));
  const double backscatter_here = in.b_inf * (1.0 - exp(-in.beta_b * here));
  const double backscatter_there = in.b_inf * (1.0 - exp(-in.beta_b * there));
  return {static_cast<float>(gain),
          static_cast<float>(backscatter_there - gain * backscatter_here) * kIntensityScale};
}

/// Costs of one hypothesis: number of observing images and the kCount lowest costs in ascending
/// order.
template <int kCount>
struct BestCosts {
  float lowest[kCount];
  int seen = 0;

  __device__ BestCosts() {
#pragma unroll
    for (int i = 0; i < kCount; ++i) lowest[i] = FLT_MAX;
  }
  __device__ void add(float cost) {
    ++seen;
#pragma unroll
    for (int i = 0; i < kCount; ++i) {
      const float larger = fmaxf(lowest[i], cost);
      lowest[i] = fminf(lowest[i], cost);
      cost = larger;
    }
  }
  __device__ float mean(int count) const {
    float sum = 0.0f;
#pragma unroll
    for (int i = 0; i < kCount; ++i) sum += i < count ? lowest[i] : 0.0f;
    return sum / static_cast<float>(count);
  }
};

struct Hypothesis {
  float2 point;
  float2 slope;
  int finest;  ///< finest pyramid level
  float w;     ///< 1/depth
  float next;  ///< 1/depth of the adjacent hypothesis
};

template <int kCount>
__device__ void add_view(const SweepPointers& in, const Hypothesis& h, int view,
                         const Patch* patches, BestCosts<kCount>& best) {
  const EpipolarLine line(in.projections + 12 * view, h.point.x, h.point.y);
  if (line.depth_factor(h.w) < kMinDepthFactor || line.depth_factor(h.next) < kMinDepthFactor)
    return;
  PatchTransform place = line.at(h.w, h.slope);
  const float2 neighbor = line.pixel(h.next);
  const float step_x = neighbor.x - place.x;
  const float step_y = neighbor.y - place.y;
  const float step = step_x * step_x + step_y * step_y;
  const ImagePyramid& pyramid = in.pyramids[view + 1];
  const int coarsest = min(pyramid.count, in.pyramids[0].count) - 1;
  int level = min(h.finest, coarsest);
  while (level < coarsest && step > kMaxStep2 * static_cast<float>(1 << (2 * level))) ++level;
  const Patch& patch = patches[level];
  const float scale = 1.0f / static_cast<float>(1 << level);
  place.x = scale * (place.x + place.xx * patch.dx + place.xy * patch.dy) - 0.5f;
  place.y = scale * (place.y + place.yx * patch.dx + place.yy * patch.dy) - 0.5f;
  const PyramidLevel& pixels = pyramid.levels[level];
  if (!inside(pixels, place)) return;
  if (!in.absolute) {
    best.add(correlation_cost(patch, pixels, place, in.noise));
    return;
  }
  const float2 water = medium_transfer(in, h.point, view, h.w);
  best.add(fminf(1.0f, difference_cost(patch, pixels, place, water.x, water.y) / kDifferenceLimit));
}

__device__ Hypothesis hypothesis_of(const SweepPointers& in, int point, int label) {
  const float* const w = in.inverse_depths + (in.shared_depths ? 0 : point * in.labels);
  const int next = label + 1 < in.labels ? label + 1 : max(label - 1, 0);
  return {.point = {in.places[2 * point], in.places[2 * point + 1]},
          .slope = {in.slopes[2 * point], in.slopes[2 * point + 1]},
          .finest = in.levels[point],
          .w = w[label],
          .next = w[next]};
}

/// A thread block has several points and distributes their hypotheses over its threads. Hypotheses
/// without observations get the mean cost of the others in `neutral_kernel`.
template <int kCount>
__global__ void sweep_kernel(const __grid_constant__ SweepPointers in, int per_block, float* cost,
                             std::uint8_t* seen) {
  __shared__ Patch patches[kMaxPoints][kDepthLevels];
  const int first = static_cast<int>(blockIdx.x) * per_block;
  const int points = min(per_block, in.points - first);
  const int warp = static_cast<int>(threadIdx.x) / kSamples;
  for (int k = warp; k < points * kDepthLevels; k += kThreads / kSamples) {
    const int level = k % kDepthLevels;
    const int point = first + k / kDepthLevels;
    if (level >= in.pyramids[0].count) continue;
    sample_patch(in.pyramids[0].levels[level], level, in.places[2 * point],
                 in.places[2 * point + 1], in.noise, in.patch_sigma,
                 patches[k / kDepthLevels][level]);
  }
  __syncthreads();
  for (int k = static_cast<int>(threadIdx.x); k < points * in.labels; k += kThreads) {
    const int own = k / in.labels;
    const Hypothesis h = hypothesis_of(in, first + own, k - own * in.labels);
    BestCosts<kCount> best;
    for (int view = 0; view < in.views; ++view) add_view(in, h, view, patches[own], best);
    const std::int64_t i = static_cast<std::int64_t>(first) * in.labels + k;
    cost[i] = best.seen > 0 ? best.mean(in.counted[best.seen]) : 0.0f;
    seen[i] = static_cast<std::uint8_t>(best.seen);
  }
}

/// One warp per point.
__global__ void neutral_kernel(int points, int labels, float* cost, const std::uint8_t* seen) {
  const int point = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x) / kSamples;
  if (point >= points) return;
  const int lane = static_cast<int>(threadIdx.x) % kSamples;
  const std::int64_t row = static_cast<std::int64_t>(point) * labels;
  float sum = 0.0f;
  float known = 0.0f;
  for (int l = lane; l < labels; l += kSamples) {
    if (seen[row + l] == 0) continue;
    sum += cost[row + l];
    known += 1.0f;
  }
  sum = warp_sum(sum);
  known = warp_sum(known);
  const float neutral = known > 0.0f ? sum / known : 1.0f;
  for (int l = lane; l < labels; l += kSamples) {
    if (seen[row + l] == 0) cost[row + l] = neutral;
  }
}

}  // namespace

cudaError_t launch_sweep(const SweepPointers& in, float* cost, std::uint8_t* seen,
                         cudaStream_t stream) {
  if (in.points == 0 || in.labels == 0) return cudaSuccess;
  const int per_block = max(1, min(kMaxPoints, kThreads / in.labels));
  const auto blocks = static_cast<unsigned>((in.points + per_block - 1) / per_block);
  const int max_count = in.counted[in.views];
  const auto kernel = max_count <= kTypicalCount   ? sweep_kernel<kTypicalCount>
                      : max_count <= kDefaultCount ? sweep_kernel<kDefaultCount>
                                                   : sweep_kernel<kMaxViews>;
  kernel<<<blocks, kThreads, 0, stream>>>(in, per_block, cost, seen);
  constexpr int kRows = kThreads / kSamples;
  neutral_kernel<<<static_cast<unsigned>((in.points + kRows - 1) / kRows), kThreads, 0, stream>>>(
      in.points, in.labels, cost, seen);
  return cudaGetLastError();
}

}  // namespace apvi::depth::cuda
