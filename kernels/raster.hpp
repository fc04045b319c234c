// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "apvi/splat/splat.hpp"

/// Launchers of the rasterizer's kernels: pointers to device memory, sizes, a stream, and nothing
/// of LibTorch. They return what the launches reported, and wait for nothing.
///
/// Gaussians that show become splats, in the order of the Gaussians. What a splat has to do with
/// one tile is a slot; the slots of a splat lie next to each other, so that sums over them have an
/// order and the derivatives the same bits from run to run. How many splats and slots there are is
/// known on the device only: buffers have a capacity, what does not fit is left out, and the host
/// reads the counts after everything has been launched, to launch again where they were too many.
namespace apvi::splat::cuda {

/// Floats of derivatives in a slot; see kSlotSize, whose last two are padding.
inline constexpr int kSlotFloats = 10;
inline constexpr int kProjectThreads = 128;
/// Floats of a row of derivatives: by mean, log scales, quaternion, logit of opacity, by the colour
/// (14 so far), the direction of view, padding. Those by the coefficients of colour are the basis
/// at that direction times those by the colour, which whoever wants them multiplies himself.
inline constexpr int kRowFloats = 20;
inline constexpr int kPoseScalars = 6;
inline constexpr int kBackgroundScalars = 3;
/// Warps of a tile, each of which draws a block of 8x8 pixels.
inline constexpr int kTileWarps = 4;
inline constexpr int kTilePixels = kTileSize * kTileSize;
/// Slots of a tile that one block draws. Tiles where the scene ends far away have a hundred times
/// as many as others; cut in chunks they do not keep the device waiting.
inline constexpr std::uint32_t kLeastChunkSlots = 128;
inline constexpr std::uint32_t kMostChunkSlots = 256;

/// Bits of a splat's number; those above name the blocks of a tile.
inline constexpr int kSplatBits = 32 - kTileWarps;

struct Frame {
  Camera<float> camera;
  int width, height;
  int sh_degree;  ///< used
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
  const float* light;            ///< [count,3] by which colours are multiplied; null: one
  int sh_rest_count;
};

struct Counts {
  std::uint32_t splats, slots;
};
struct SlotRange {
  std::uint32_t begin, count;
};

/// A splat's tiles where they fit in a square of kTileSquare x kTileSquare, which is nearly always:
/// what the projection leaves in place of a splat's SlotRange, so that listing them takes neither
/// the splat nor any arithmetic.
inline constexpr int kTileSquare = 4;
inline constexpr std::uint32_t kFewTiles = 1U << 31U;
struct FewTiles {
  int x, y;            ///< of the square's first tile
  std::uint32_t mask;  ///< which of its tiles, row by row

  APVI_HD SlotRange pack(std::uint32_t count) const {
    return {kFewTiles | static_cast<std::uint32_t>(y) << 12U | static_cast<std::uint32_t>(x),
            mask << 16U | count};
  }
  static APVI_HD FewTiles unpack(const SlotRange& r) {
    return {static_cast<int>(r.begin & 0xfffU), static_cast<int>(r.begin >> 12U & 0xfffU),
            r.count >> 16U};
  }
};

/// Bits of a digit of a key by depth, of which there are three where no depth is nearer than
/// kShortDepths, else four.
inline constexpr int kDepthBits = 9;
inline constexpr float kShortDepths = 1.0f / 256.0f;  // [m]
inline APVI_HD int depth_passes(float near) {
  return near < kShortDepths ? 4 : 3;
}

/// Blocks of the projection, each of which leaves one partial count.
std::int64_t project_blocks(std::int64_t count);

/// What the projection leaves.
struct SplatPointers {
  std::uint32_t capacity;
  std::uint32_t slot_capacity;
  Splat<float>* splats;             ///< [capacity]
  std::uint32_t* gaussian;          ///< [capacity] of which Gaussian
  SlotRange* slots;                 ///< [capacity] left by the binning; before it, see FewTiles
  std::uint32_t* depth_keys;        ///< [capacity]
  unsigned long long* block_state;  ///< [project_blocks + 1] zeros; the last counts the blocks
  Counts* counts;                   ///< [1]
  Counts* host_counts;              ///< the same in memory that the host reads
};

/// All null where only the images are wanted.
struct StatisticsPointers {
  bool* visible;      ///< [count]
  float* radii_px;    ///< [count]
  float* max_weight;  ///< [count]
  std::int32_t* row;  ///< [count] which splat; -1: none
};

cudaError_t launch_project(const GaussianPointers& in, const Frame& frame, const SplatPointers& out,
                           const StatisticsPointers& statistics, cudaStream_t stream);

/// Colours of the splats. `visible`, `radii_px` and `row` change where a colour is no number.
cudaError_t launch_shade(const GaussianPointers& in, const Frame& frame,
                         const SplatPointers& splats, const StatisticsPointers& statistics,
                         cudaStream_t stream);

inline constexpr int kChunkKinds = 15;
/// How far the drawing is. Binning clears it.
struct DrawingState {
  std::uint32_t* begun;  ///< [1] chunks
  std::uint32_t* kinds;  ///< [kChunkKinds] of chunks, by when they begin
  std::uint32_t* drawn;  ///< [tiles] chunks of each
  std::uint32_t* ready;  ///< [chunk_capacity] whether a chunk's `through` is there
};
/// Which slots each tile draws, in order, and in which order its chunks are drawn.
struct BinPointers {
  std::uint32_t* slot_splat;  ///< [slot_capacity] of which splat; null for the images alone
  /// [slot_capacity] by tile, within it by depth; for the images alone splats instead of slots.
  std::uint32_t* tile_slots;
  /// [slot_capacity] which splats a chunk draws, in a row from its first slot on, and in the upper
  /// bits in which of the tile's blocks. Left by the drawing, which puts their slots in
  /// `tile_slots`.
  std::uint32_t* tile_draws;
  std::uint32_t* tile_begin;   ///< [tiles + 1]
  std::uint32_t chunk_slots;   ///< that `chunk_slots` says
  std::uint32_t* chunk_begin;  ///< [tiles + 1] first chunk of each tile, which has one at least
  std::uint32_t* chunk_tile;   ///< [chunk_capacity]
  std::uint32_t* chunk_drawn;  ///< [chunk_capacity] how many those are
  std::uint32_t* turns;        ///< [chunk_capacity] chunks, those of a tile in their order
  std::uint32_t* dark;         ///< [tiles] the chunk behind which no pixel shows anything
  DrawingState drawing;
  void* state;    ///< `bin_state_bytes` of zeros
  void* scratch;  ///< `bin_scratch_bytes`
};
/// Slots of a chunk, so that there are chunks for the whole device, and how many there can be.
std::uint32_t chunk_slots(std::uint32_t slot_capacity);
std::uint32_t chunk_capacity(std::uint32_t slot_capacity, std::uint32_t chunk_slots, int tiles);
std::size_t bin_state_bytes(std::uint32_t capacity, std::uint32_t slot_capacity,
                            const Frame& frame);
std::size_t bin_scratch_bytes(std::uint32_t capacity, std::uint32_t slot_capacity, int tiles);
/// In three parts: lists the slots by depth and finds where the tiles and their chunks begin; says
/// what there is to know of the chunks; sorts the slots by tile. The latter two need only the first
/// one's end.
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
/// What the chunks leave of each of their pixels, two to a thread.
struct ChunkPointers {
  float2* through;  ///< [chunks,128] how much light they let through, alone; not of a tile's last
  float2* start;    ///< [chunks,128] light that they begin with; negative: none; not of the first
  float2* end;      ///< [chunks,128] light behind them; negative: finished in them, 0: before them
  float4* sums;     ///< [chunks,128,2] weighted sums of colour and depth, of all before in the end
};
/// `slot_weight` [slot_capacity]: the largest weight of each slot; null for the images alone, for
/// which `tile_draws`, `chunk_drawn` and `start` are not needed. Raises max_weight.
cudaError_t launch_blend(const Frame& frame, const SplatPointers& splats, const BinPointers& bins,
                         const ImagePointers& image, const ChunkPointers& chunks,
                         float* slot_weight, const StatisticsPointers& statistics,
                         cudaStream_t stream);

struct ImageGradientPointers {
  const float* color;  ///< [H,W,3]
  const float* depth;  ///< [H,W] or null, for zero
  const float* alpha;  ///< [H,W] or null, for zero
};
/// Where derivatives by the Gaussians go. Either into tensors like theirs, zeros before, of which
/// only the rows of splats are written; or, when `rows` is not null, into rows by splat.
struct GaussianGradientPointers {
  float* rows;  ///< [capacity,kRowFloats]
  float* means;
  float* log_scales;
  float* quaternions;
  float* logit_opacities;
  float* sh_dc;
  float* sh_rest;
  float* mean2d;  ///< [count] zeros before; always
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

}  // namespace apvi::splat::cuda
