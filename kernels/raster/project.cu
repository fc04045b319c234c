// SPDX-License-Identifier: BSD-3-Clause
// Projection of all Gaussians to splats in one pass; colors of the visible ones in another, as
// sorting does not wait for them.
#include <cub/block/block_scan.cuh>

#include "kernels/raster/look_back.cuh"

namespace apvi::gaussians::cuda {
namespace {

/// Color of a Gaussian; `row` holds its SH coefficients.
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

struct ProjectedSplat {
  Splat<float> splat;
  std::uint32_t tiles;  ///< 0: not visible
  SlotRange packed;     ///< tile count, or the tiles themselves, see TileMask
};

/// Bits of a row of a tile mask that begins at `x`.
__device__ std::uint32_t row_bits(PixelSpan columns, int x) {
  if (columns.first > columns.last) return 0;
  return (2U << (columns.last - columns.first)) - 1 << (columns.first - x);
}

__device__ void find_tiles(const Frame& frame, ProjectedSplat& projected_splat) {
  const PixelSpan rows = row_span(projected_splat.splat, frame.height);
  PixelSpan tile_rows[kTileMaskSide];  // the first rows
  int first = frame.tiles_x();
  int last = -1;
  int count = 0;
  const int top = rows.first / kTileSize;
  const auto columns_in = [&](int tile_row) {
    PixelSpan columns = {0, -1};
    if (tile_row * kTileSize > rows.last) return columns;
    columns = tile_column_span(projected_splat.splat, rows, tile_row, frame.width);
    if (columns.first > columns.last) return columns;
    first = min(first, columns.first);
    last = max(last, columns.last);
    count += columns.last - columns.first + 1;
    return columns;
  };
#pragma unroll
  for (int k = 0; k < kTileMaskSide; ++k) tile_rows[k] = columns_in(top + k);
  bool has_mask = last - first < kTileMaskSide;
  for (int tile_row = top + kTileMaskSide; tile_row * kTileSize <= rows.last; ++tile_row) {
    columns_in(tile_row);
    has_mask = false;
  }
  projected_splat.tiles = static_cast<std::uint32_t>(count);
  projected_splat.packed = {0, projected_splat.tiles};
  if (!has_mask) return;
  std::uint32_t mask = 0;
#pragma unroll
  for (int k = 0; k < kTileMaskSide; ++k)
    mask |= row_bits(tile_rows[k], first) << (kTileMaskSide * k);
  projected_splat.packed = TileMask{first, top, mask}.pack(projected_splat.tiles);
}

/// Depth sort key. Three digits keep all bits up to 16,000 times the near plane (164 m for 1 cm),
/// then all but three bits, within the rounding of the projection, up to 10^9 times; larger depths
/// are equal.
__device__ std::uint32_t depth_key(float z, float near) {
  constexpr std::uint32_t kWhole = 14U << 23U;
  constexpr std::uint32_t kLast = (1U << 3 * kDepthBits) - 1;
  if (depth_passes(near) > 3) return __float_as_uint(z);
  const std::uint32_t above = __float_as_uint(z) - __float_as_uint(near);
  return above < kWhole ? above : min(kWhole + (above - kWhole >> 3U), kLast);
}

__device__ ProjectedSplat find_footprint(const GaussianPointers& g, const Frame& frame,
                                         std::int64_t i) {
  ProjectedSplat out;
  out.tiles = 0;
  const ProjectedGaussian projected = project_gaussian(g, frame, i);
  float record[16];
  const bool visible =
      compute_splat(frame.camera, projected.f, projected.opacity * projected.opacity_scale,
                    static_cast<float>(frame.width), static_cast<float>(frame.height), record);
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
               .extent_y2 = record[12],
               .extent_x = record[13],
               .tip_dy = record[14],
               .radius = record[15]};
  if (visible) find_tiles(frame, out);
  return out;
}

constexpr int kParts = sizeof(Splat<float>) / sizeof(float4);

/// The splats of a block, staged for coalesced writes.
struct Staged {
  float4 parts[kProjectThreads * kParts];

  /// Position of a part of a splat, swizzled to avoid bank conflicts.
  static __device__ int place(int rank, int part) {
    return kParts * rank + (part ^ (rank >> 1 & (kParts - 1)));
  }
  __device__ void stage(int rank, const Splat<float>& splat) {
    const auto* const from = reinterpret_cast<const float4*>(&splat);
    for (int k = 0; k < kParts; ++k) parts[place(rank, k)] = from[k];
  }
  __device__ void store(int count, Splat<float>* splats) const {
    auto* const to = reinterpret_cast<float4*>(splats);
    for (auto k = static_cast<int>(threadIdx.x); k < count * kParts; k += kProjectThreads) {
      to[k] = parts[place(k / kParts, k % kParts)];
    }
  }
};

__device__ void store(const SplatPointers& out, std::uint32_t to,
                      const ProjectedSplat& projected_splat, const Frame& frame,
                      std::uint32_t gaussian) {
  if (to >= out.capacity) return;
  out.gaussian[to] = gaussian;
  out.slots[to] = projected_splat.packed;
  out.depth_keys[to] = depth_key(projected_splat.splat.z, frame.camera.near_m);
}

__global__ void __launch_bounds__(kProjectThreads)
    project_kernel(GaussianPointers g, Frame frame, SplatPointers out,
                   StatisticsPointers statistics, unsigned blocks) {
  using Scan = cub::BlockScan<Packed, kProjectThreads>;
  __shared__ typename Scan::TempStorage scan_storage;
  __shared__ unsigned block_shared;
  __shared__ Packed before_shared;
  __shared__ Staged staged;
  const unsigned block = take_ticket(out.block_state, blocks, block_shared);
  const std::int64_t i = static_cast<std::int64_t>(block) * kProjectThreads + threadIdx.x;
  ProjectedSplat projected_splat;
  projected_splat.tiles = 0;
  if (i < g.count) projected_splat = find_footprint(g, frame, i);
  Packed at = 0;
  Packed own = 0;
  Scan(scan_storage)
      .ExclusiveSum(pack(projected_splat.tiles != 0 ? 1 : 0, projected_splat.tiles), at, own);
  if (threadIdx.x < kWarp) {
    const Packed before = count_before(out.block_state, block, own);
    if (threadIdx.x == 0) before_shared = before;
    if (threadIdx.x == 0 && block == blocks - 1) {
      *out.counts = {splats_in(before + own), slots_in(before + own)};
      *out.host_counts = *out.counts;
    }
  }
  const bool is_visible = projected_splat.tiles != 0;
  if (is_visible) staged.stage(static_cast<int>(splats_in(at)), projected_splat.splat);
  __syncthreads();
  const std::uint32_t begin = splats_in(before_shared);
  const std::uint32_t room = out.capacity - min(out.capacity, begin);
  staged.store(static_cast<int>(min(splats_in(own), room)), out.splats + begin);
  at += before_shared;
  if (i >= g.count) return;
  if (is_visible) store(out, splats_in(at), projected_splat, frame, static_cast<std::uint32_t>(i));
  if (statistics.visible == nullptr) return;
  statistics.visible[i] = is_visible;
  statistics.radii_px[i] = is_visible ? projected_splat.splat.radius : 0.0f;
  statistics.max_weight[i] = 0.0f;
  statistics.row[i] = is_visible ? static_cast<std::int32_t>(splats_in(at)) : -1;
}

/// A splat with an invalid color keeps its place but touches no pixel.
__device__ void invalidate(Splat<float>& splat, const StatisticsPointers& statistics,
                           std::int64_t i) {
  splat.e_0 = -INFINITY;
  splat.radius = 0.0f;
  if (statistics.visible == nullptr) return;
  statistics.visible[i] = false;
  statistics.radii_px[i] = 0.0f;
  statistics.row[i] = -1;
}

__global__ void __launch_bounds__(kProjectThreads)
    shade_kernel(GaussianPointers g, Frame frame, SplatPointers splats,
                 StatisticsPointers statistics) {
  __shared__ float coefficients[kProjectThreads * kShStride];
  float* const rows = coefficients + threadIdx.x / kWarp * kWarp * kShStride;
  const std::uint32_t at = blockIdx.x * kProjectThreads + threadIdx.x;
  const bool wanted = at < min(splats.counts->splats, splats.capacity);
  const std::uint32_t i = wanted ? splats.gaussian[at] : 0;
  fetch_sh(g, frame.sh_degree, wanted, i, rows);
  float mean[3] = {};
  if (wanted) load3(g.means, i, mean);
  __pipeline_wait_prior(0);
  __syncwarp();
  if (!wanted) return;
  float color[3];
  shade(g, frame, i, mean, rows + threadIdx.x % kWarp * kShStride, color);
  bool is_visible = true;
  for (const float c : color) is_visible = is_visible && c < 1e30f && c > -1e30f;
  Splat<float>& splat = splats.splats[at];
  for (int c = 0; c < 3; ++c) {
    const float light = g.light != nullptr ? g.light[3 * std::int64_t{i} + c] : 1.0f;
    splat.color[c] = is_visible ? light * clamp_min(color[c], 0.0f) : 0.0f;
  }
  if (!is_visible) invalidate(splat, statistics, i);
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

cudaError_t launch_shade(const GaussianPointers& in, const Frame& frame,
                         const SplatPointers& splats, const StatisticsPointers& statistics,
                         cudaStream_t stream) {
  const unsigned blocks = (splats.capacity + kProjectThreads - 1) / kProjectThreads;
  shade_kernel<<<blocks, kProjectThreads, 0, stream>>>(in, frame, splats, statistics);
  return cudaGetLastError();
}

}  // namespace apvi::gaussians::cuda
