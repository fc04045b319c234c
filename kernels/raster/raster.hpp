// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "gaussians/render/splat.hpp"

/// Launchers of the rasterizer kernels: device pointers, sizes and a stream, without LibTorch. They
/// return the launch error and do not synchronize.
///
/// Visible Gaussians become splats, in the order of the Gaussians. A slot is one splat in one tile;
/// the slots of a splat are contiguous, so sums over them have a fixed order and gradients are
/// deterministic. The numbers of splats and slots are known on the device only: buffers have a
/// capacity, what exceeds it is dropped, and the host reads the counts after launching everything,
/// to repeat with larger buffers if necessary.
namespace apvi::gaussians::cuda {

/// Floats per slot of derivatives; see kSlotSize, without its padding.
inline constexpr int kSlotFloats = 10;
inline constexpr int kProjectThreads = 128;
/// Floats per row of the sparse gradient: by mean, log scales, quaternion, opacity logit and color
/// (14 in total), the view direction, padding. The gradient of the SH coefficients is the basis at
/// that direction times the color gradient, computed by the consumer.
inline constexpr int kRowFloats = 20;
inline constexpr int kPoseScalars = 6;
inline constexpr int kBackgroundScalars = 3;
/// Warps per tile, each of which blends a block of 8x8 pixels.
inline constexpr int kTileWarps = 4;
inline constexpr int kTilePixels = kTileSize * kTileSize;
/// Slots of a tile that one block blends. Tiles with distant background have a hundred times as
/// many slots as others; splitting them into chunks balances the load.
inline constexpr std::uint32_t kMinChunkSlots = 128;
inline constexpr std::uint32_t kMaxChunkSlots = 256;

/// Bits of a splat index; the bits above hold the mask of the tile's blocks.
inline constexpr int kSplatBits = 32 - kTileWarps;

struct Frame {
  Camera<float> camera;
  int width, height;
  int sh_degree;  ///< degree to evaluate
  bool antialiased;

  APVI_HD int tiles_x() const { return (width + kTileSize - 1) / kTileSize; }
  APVI_HD int tiles_y() const { return (height + kTileSize - 1) / kTileSize; }
  APVI_HD int tiles() const { return tiles_x() * tiles_y(); }
};

struct GaussianPointers {
  std::int64_t count;
  const float* means;            ///< [count,3]
  const float* log_scales;       ///< [count,3]
  const float* quaternions;      ///< [count,4]
  const float* logit_opacities;  ///< [count]
  const float* sh_dc;            ///< [count,3]
  const float* sh_rest;          ///< [count,sh_rest_count,3]
  const float* light;            ///< [count,3] color factor; null: one
  int sh_rest_count;
};

struct Counts {
  std::uint32_t splats, slots;
};
struct SlotRange {
  std::uint32_t begin, count;
};

/// A splat's tiles as a bit mask if they fit into kTileMaskSide x kTileMaskSide tiles, which is
/// nearly always: the projection stores it in place of the splat's SlotRange, so that listing the
/// tiles needs neither the splat nor arithmetic.
inline constexpr int kTileMaskSide = 4;
inline constexpr std::uint32_t kTileMaskFlag = 1U << 31U;
struct TileMask {
  int x, y;            ///< first tile of the square
  std::uint32_t mask;  ///< tiles of the square, row by row

  APVI_HD SlotRange pack(std::uint32_t count) const {
    return {kTileMaskFlag | static_cast<std::uint32_t>(y) << 12U | static_cast<std::uint32_t>(x),
            mask << 16U | count};
  }
  static APVI_HD TileMask unpack(const SlotRange& r) {
    return {static_cast<int>(r.begin & 0xfffU), static_cast<int>(r.begin >> 12U & 0xfffU),
            r.count >> 16U};
  }
};

/// Bits per digit of a depth key; three digits if the near plane is not below kShortKeyMinDepth_m,
/// else four.
inline constexpr int kDepthBits = 9;
inline constexpr float kShortKeyMinDepth_m = 1.0f / 256.0f;
inline APVI_HD int depth_passes(float near) {
  return near < kShortKeyMinDepth_m ? 4 : 3;
}

/// Blocks of the projection; each writes one partial count.
std::int64_t project_blocks(std::int64_t count);

/// Output of the projection.
struct SplatPointers {
  std::uint32_t capacity;
  std::uint32_t slot_capacity;
  Splat<float>* splats;       ///< [capacity]
  std::uint32_t* gaussian;    ///< [capacity] index of the Gaussian
  SlotRange* slots;           ///< [capacity] set by the binning; before it, see TileMask
  std::uint32_t* depth_keys;  ///< [capacity]
  unsigned long long*
      block_state;      ///< [project_blocks + 1] zero-initialized; the last is a block counter
  Counts* counts;       ///< [1]
  Counts* host_counts;  ///< the same in host memory
};

/// All null when only images are rendered.
struct StatisticsPointers {
  bool* visible;      ///< [count]
  float* radii_px;    ///< [count]
  float* max_weight;  ///< [count]
  std::int32_t* row;  ///< [count] splat index; -1: none
};

cudaError_t launch_project(const GaussianPointers& in, const Frame& frame, const SplatPointers& out,
                           const StatisticsPointers& statistics, cudaStream_t stream);

/// Computes the colors of the splats. Clears `visible`, `radii_px` and `row` where a color is not
/// finite.
cudaError_t launch_shade(const GaussianPointers& in, const Frame& frame,
                         const SplatPointers& splats, const StatisticsPointers& statistics,
                         cudaStream_t stream);

inline constexpr int kChunkKinds = 15;
/// Progress of the blending. Cleared by the binning.
struct DrawingState {
  std::uint32_t* started;   ///< [1] number of chunks started
  std::uint32_t* kinds;     ///< [kChunkKinds] start of each kind in the chunk order
  std::uint32_t* finished;  ///< [tiles] finished chunks of each tile
  std::uint32_t* ready;     ///< [chunk_capacity] whether a chunk's `transmittance` is published
};
/// Slots of each tile in blending order, and the order in which chunks are blended.
struct BinPointers {
  std::uint32_t* slot_splat;  ///< [slot_capacity] splat of each slot; null for images only
  /// [slot_capacity] by tile, within a tile by depth; splats instead of slots for images only.
  std::uint32_t* tile_slots;
  /// [slot_capacity] splats with a contribution, per chunk, contiguous from its first slot; the
  /// upper bits hold the mask of the tile's blocks. Written by the blending, which reorders
  /// `tile_slots` accordingly.
  std::uint32_t* tile_draws;
  std::uint32_t* tile_begin;        ///< [tiles + 1]
  std::uint32_t chunk_slots;        ///< slots per chunk, from `chunk_slots`
  std::uint32_t* chunk_begin;       ///< [tiles + 1] first chunk of each tile, at least one per tile
  std::uint32_t* chunk_tile;        ///< [chunk_capacity]
  std::uint32_t* chunk_draw_count;  ///< [chunk_capacity] number of `tile_draws` of a chunk
  std::uint32_t* chunk_order;  ///< [chunk_capacity] chunks in launch order, front to back per tile
  std::uint32_t* last_visible_chunk;  ///< [tiles] chunk in which the last pixel finished
  DrawingState drawing;
  void* state;    ///< `bin_state_bytes`, zero-initialized
  void* scratch;  ///< `bin_scratch_bytes`
};
/// Slots per chunk, chosen to occupy the whole device, and the maximum number of chunks.
std::uint32_t chunk_slots(std::uint32_t slot_capacity);
std::uint32_t chunk_capacity(std::uint32_t slot_capacity, std::uint32_t chunk_slots, int tiles);
std::size_t bin_state_bytes(std::uint32_t capacity, std::uint32_t slot_capacity,
                            const Frame& frame);
std::size_t bin_scratch_bytes(std::uint32_t capacity, std::uint32_t slot_capacity, int tiles);
/// In three parts: lists the slots by depth and finds the first slot and chunk of each tile;
/// initializes the chunks; sorts the slots by tile. The latter two depend only on the first.
cudaError_t launch_list(const Frame& frame, const SplatPointers& splats, const BinPointers& out,
                        cudaStream_t stream);
cudaError_t launch_place_chunks(const Frame& frame, const BinPointers& out, cudaStream_t stream);
cudaError_t launch_sort(const Frame& frame, const SplatPointers& splats, const BinPointers& out,
                        cudaStream_t stream);

struct ImagePointers {
  const float* background;  ///< [3]
  float* color;             ///< [H,W,3]
  float* depth;             ///< [H,W]
  float* alpha;             ///< [H,W]
};
/// Per-pixel results of the chunks, two pixels per thread.
struct ChunkPointers {
  float2*
      transmittance;  ///< [chunks,128] transmittance of the chunk alone; not for the last of a tile
  float2* start;  ///< [chunks,128] transmittance at its start; negative: none; not for the first
  float2* end;    ///< [chunks,128] transmittance at its end; negative: finished in it, 0: before it
  float4* sums;   ///< [chunks,128,2] weighted sums of color and depth; finally of all chunks before
};
/// `slot_weight` [slot_capacity]: largest blend weight of each slot; null for images only, which do
/// not need `tile_draws`, `chunk_draw_count` and `start`. Updates max_weight.
cudaError_t launch_blend(const Frame& frame, const SplatPointers& splats, const BinPointers& bins,
                         const ImagePointers& image, const ChunkPointers& chunks,
                         float* slot_weight, const StatisticsPointers& statistics,
                         cudaStream_t stream);

struct ImageGradientPointers {
  const float* color;  ///< [H,W,3]
  const float* depth;  ///< [H,W] or null, for zero
  const float* alpha;  ///< [H,W] or null, for zero
};
/// Destination of the gradient: either dense, zero-initialized tensors, of which only rows of
/// splats are written; or, when `rows` is not null, one row per splat.
struct GaussianGradientPointers {
  float* rows;  ///< [capacity,kRowFloats]
  float* means;
  float* log_scales;
  float* quaternions;
  float* logit_opacities;
  float* sh_dc;
  float* sh_rest;
  float* mean2d;  ///< [count] zero-initialized; always written
};
struct BackwardScratch {
  float* slot_gradient;        ///< [slot_capacity,kSlotFloats]
  float* background_partials;  ///< [tiles * kTileWarps,kBackgroundScalars]
  float* pose_partials;        ///< [blocks of splats,kPoseScalars]
  double* sums;                ///< [kPoseScalars + kBackgroundScalars]: the results
};
std::int64_t pose_partial_rows(std::uint32_t capacity);
cudaError_t launch_blend_backward(const Frame& frame, const SplatPointers& splats,
                                  const BinPointers& bins, const ImagePointers& image,
                                  const ChunkPointers& chunks, const ImageGradientPointers& grad,
                                  const BackwardScratch& scratch, cudaStream_t stream);
cudaError_t launch_project_backward(const GaussianPointers& in, const Frame& frame,
                                    const SplatPointers& splats, const float* slot_weight,
                                    const float* max_weight, const BackwardScratch& scratch,
                                    const GaussianGradientPointers& out, cudaStream_t stream);

}  // namespace apvi::gaussians::cuda
