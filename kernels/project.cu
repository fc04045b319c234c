// SPDX-License-Identifier: BSD-3-Clause
// From Gaussians to splats, in one pass over all of them. Where a block's splats go it learns from
// the blocks before it while they run (Merrill and Garland, "Single-pass parallel prefix scan with
// decoupled look-back", 2016).
#include <cub/block/block_scan.cuh>

#include "gaussian_rows.cuh"

namespace apvi::splat::cuda {
namespace {

using Packed = unsigned long long;

// A count of splats and one of slots in one word, with what the word is in its upper bits.
constexpr int kSlotBits = 34;
constexpr Packed kValue = (Packed{1} << 62) - 1;
constexpr Packed kOwn = Packed{1} << 62;     // the count of a block alone
constexpr Packed kPrefix = Packed{1} << 63;  // with all before it

__device__ Packed pack(std::uint32_t splats, std::uint32_t slots) {
  return static_cast<Packed>(splats) << kSlotBits | slots;
}
__device__ std::uint32_t splats_in(Packed p) {
  return static_cast<std::uint32_t>((p & kValue) >> kSlotBits);
}
__device__ std::uint32_t slots_in(Packed p) {
  return static_cast<std::uint32_t>(p & ((Packed{1} << kSlotBits) - 1));
}

/// What the blocks before `block` have, found by its first warp, who says what this one has.
__device__ Packed count_before(volatile Packed* states, unsigned block, Packed own) {
  const int lane = static_cast<int>(threadIdx.x);
  if (lane == 0) states[block] = (block == 0 ? kPrefix : kOwn) | own;
  Packed before = 0;
  for (int at = static_cast<int>(block) - 1 - lane; block != 0; at -= kWarp) {
    Packed state = kPrefix;
    do {
      if (at >= 0) state = states[at];
    } while (__any_sync(kAllLanes, (state & (kOwn | kPrefix)) == 0));
    const unsigned known = __ballot_sync(kAllLanes, (state & kPrefix) != 0);
    const int last = known != 0 ? __ffs(static_cast<int>(known)) - 1 : kWarp - 1;
    before += warp_sum(lane <= last ? state & kValue : Packed{0});
    if (known != 0) break;
  }
  if (lane == 0 && block != 0) states[block] = kPrefix | (before + own);
  return before;
}

/// Colour of a Gaussian; its coefficients lie in `row`.
__device__ void shade(const GaussianPointers& g, const Frame& frame, std::int64_t i,
                      const float* mean, const float* row, float* color) {
  load3(g.sh_dc, i, color);
  for (int c = 0; c < 3; ++c) color[c] = fmaf(color[c], static_cast<float>(kSh0), 0.5f);
  if (frame.sh_degree == 0) return;
  float direction[3];
  view_direction(frame.camera, mean, direction);
  float basis[kMaxShRest];
  sh_basis(frame.sh_degree, direction[0], direction[1], direction[2], basis);
#pragma unroll
  for (int k = 0; k < kMaxShRest; ++k) {
    if (k >= sh_rest_used(frame.sh_degree)) break;
    for (int c = 0; c < 3; ++c) color[c] = fmaf(basis[k], row[3 * k + c], color[c]);
  }
}

__device__ std::uint32_t count_tiles(const Splat<float>& s, const Frame& frame) {
  const PixelSpan rows = rows_of(s, frame.height);
  int count = 0;
  for (int band = rows.first / kTileSize; band * kTileSize <= rows.last; ++band) {
    const PixelSpan columns = tiles_in_band(s, rows, band, frame.width);
    count += columns.last - columns.first + 1;
  }
  return static_cast<std::uint32_t>(count);
}

struct Drawn {
  Splat<float> splat;
  std::uint32_t tiles;  ///< 0: not drawn
  float mean[3];
};

__device__ Drawn find_footprint(const GaussianPointers& g, const Frame& frame, std::int64_t i) {
  Drawn out;
  out.tiles = 0;
  const Shape shape = load_shape(g, frame, i);
  for (int k = 0; k < 3; ++k) out.mean[k] = shape.mean[k];
  float record[16];
  const bool seen =
      describe(frame.camera, shape.f, shape.opacity * shape.fade, static_cast<float>(frame.width),
               static_cast<float>(frame.height), record);
  out.splat = {.u = record[0],
               .v = record[1],
               .e_0 = record[2],
               .e_xx = record[3],
               .e_xy = record[4],
               .e_yy = record[5],
               .color = {},
               .z = record[9],
               .slope = record[10],
               .half = record[11],
               .reach_y2 = record[12],
               .reach_x = record[13],
               .lean = record[14],
               .radius = record[15]};
  if (seen) out.tiles = count_tiles(out.splat, frame);
  return out;
}

/// Whether the centre lies where most Gaussians that show have theirs.
__device__ bool likely_seen(const GaussianPointers& g, const Camera<float>& camera,
                            std::int64_t i) {
  float mean[3];
  float p[3];
  load3(g.means, i, mean);
  rotate(camera.R, mean, p);
  for (int k = 0; k < 3; ++k) p[k] += camera.t[k];
  return p[2] >= camera.near_m && p[0] >= camera.x_min * p[2] && p[0] <= camera.x_max * p[2] &&
         p[1] >= camera.y_min * p[2] && p[1] <= camera.y_max * p[2];
}

__device__ void store(const SplatPointers& out, std::uint32_t to, const Drawn& drawn,
                      std::uint32_t gaussian, std::uint32_t slot_begin) {
  if (to >= out.capacity) return;
  const auto* const from = reinterpret_cast<const float4*>(&drawn.splat);
  for (int k = 0; k < 4; ++k) reinterpret_cast<float4*>(out.splats + to)[k] = from[k];
  out.gaussian[to] = gaussian;
  out.slots[to] = {slot_begin, drawn.tiles};
  out.depth_keys[to] = __float_as_uint(drawn.splat.z);  // of a positive float: sorts as it does
  out.order[to] = to;
}

__global__ void __launch_bounds__(kProjectThreads)
    project_kernel(GaussianPointers g, Frame frame, SplatPointers out,
                   StatisticsPointers statistics, unsigned blocks) {
  using Scan = cub::BlockScan<Packed, kProjectThreads>;
  __shared__ typename Scan::TempStorage scan_storage;
  __shared__ float coefficients[kProjectThreads * kShStride];
  __shared__ unsigned block_shared;
  __shared__ Packed before_shared;
  if (threadIdx.x == 0) {
    block_shared = static_cast<unsigned>(atomicAdd(out.block_state + blocks, Packed{1}));
  }
  __syncthreads();
  const unsigned block = block_shared;
  const std::int64_t i = static_cast<std::int64_t>(block) * kProjectThreads + threadIdx.x;
  Drawn drawn;
  drawn.tiles = 0;
  float* const rows = coefficients + threadIdx.x / kWarp * kWarp * kShStride;
  // The coefficients of most are on their way while their footprints are found.
  const bool likely = i < g.count && likely_seen(g, frame.camera, i);
  fetch_sh(g, frame.sh_degree, likely, static_cast<std::uint32_t>(i), rows);
  if (i < g.count) drawn = find_footprint(g, frame, i);
  fetch_sh(g, frame.sh_degree, drawn.tiles != 0 && !likely, static_cast<std::uint32_t>(i), rows);
  Packed at = 0;
  Packed own = 0;
  Scan(scan_storage).ExclusiveSum(pack(drawn.tiles != 0 ? 1 : 0, drawn.tiles), at, own);
  if (threadIdx.x < kWarp) {
    const Packed before = count_before(out.block_state, block, own);
    if (threadIdx.x == 0) before_shared = before;
    if (threadIdx.x == 0 && block == blocks - 1) {
      *out.counts = {splats_in(before + own), slots_in(before + own)};
      *out.host_counts = *out.counts;
    }
  }
  __pipeline_wait_prior(0);
  __syncthreads();
  at += before_shared;
  if (i >= g.count) return;
  bool shows = drawn.tiles != 0;
  if (shows) {
    float color[3];
    shade(g, frame, i, drawn.mean, rows + threadIdx.x % kWarp * kShStride, color);
    for (int c = 0; c < 3; ++c) {
      if (!(color[c] < 1e30f && color[c] > -1e30f)) shows = false;
      drawn.splat.color[c] = shows ? at_least(color[c], 0.0f) : 0.0f;
    }
    if (!shows) {  // it has its place already, but touches no pixel
      drawn.splat.e_0 = -INFINITY;
      drawn.splat.radius = 0.0f;
    }
    store(out, splats_in(at), drawn, static_cast<std::uint32_t>(i), slots_in(at));
  }
  statistics.visible[i] = shows;
  statistics.radii_px[i] = shows ? drawn.splat.radius : 0.0f;
  statistics.max_weight[i] = 0.0f;
  statistics.row[i] = shows ? static_cast<std::int32_t>(splats_in(at)) : -1;
}

}  // namespace

std::int64_t project_blocks(std::int64_t count) {
  return count == 0 ? 1 : (count + kProjectThreads - 1) / kProjectThreads;
}

cudaError_t launch_project(const GaussianPointers& in, const Frame& frame, const SplatPointers& out,
                           const StatisticsPointers& statistics, cudaStream_t stream) {
  const auto blocks = static_cast<unsigned>(project_blocks(in.count));
  project_kernel<<<blocks, kProjectThreads, 0, stream>>>(in, frame, out, statistics, blocks);
  return cudaGetLastError();
}

}  // namespace apvi::splat::cuda
