// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "apvi/splat/splat.hpp"

/// The inner loops of the CPU rasterizer, compiled once for every instruction set. Plain pointers
/// only: a template of the standard library or of LibTorch that was compiled here for a wide
/// instruction set could be the copy that the linker keeps for the whole program.
namespace apvi::splat {

/// One Gaussian in one tile. `slot` counts them Gaussian by Gaussian: results are written there,
/// where the sum over a Gaussian's tiles finds them in an order that no thread disturbs.
struct Entry {
  std::uint32_t splat;
  std::uint32_t slot;
};

template <typename T>
struct ProjectArgs {
  std::int64_t count;
  const T* means;
  const T* log_scales;
  const T* quaternions;
  const T* logit_opacities;
  const T* sh_dc;
  const T* sh_rest;
  const T* light;     // [count, 3]; null: one
  int sh_rest_count;  // stored per Gaussian
  int sh_degree;      // used
  int width, height;
  bool antialiased;
  Camera<T> camera;
  Splat<T>* splats;  // [count]
};

template <typename T>
struct ProjectBackwardArgs {
  ProjectArgs<T> forward;
  const std::uint32_t* slot_begin;  // [count + 1]
  const T* slot_weight;             // as `blend` left it
  const T* slot_gradient;           // [slots, kSlotSize]; undefined where the weight is 0 or less
  T* means;
  T* log_scales;
  T* quaternions;
  T* logit_opacities;
  T* sh_dc;
  T* sh_rest;
  T* mean2d;
};

template <typename T>
struct BlendArgs {
  int width, height, tiles_x;
  const Splat<T>* splats;
  const Entry* entries;
  const std::uint32_t* tile_begin;  // [tiles + 1]
  T background[3];
  T* color;
  T* depth;
  T* alpha;
  T* slot_weight;  // [slots] largest blend weight; negative: none, but see `draw`
};

template <typename T>
struct BlendBackwardArgs {
  BlendArgs<T> forward;
  const T* grad_color;
  const T* grad_depth;  // or null, for zero
  const T* grad_alpha;  // or null, for zero
  T* slot_gradient;
};

template <typename T>
struct RasterKernels {
  /// Fills splats [begin, end).
  void (*project)(const ProjectArgs<T>&, std::int64_t begin, std::int64_t end);
  void (*blend)(const BlendArgs<T>&, int tile);
  /// Fills the slots of non-zero weight; adds the derivative by the background to `background[3]`.
  void (*blend_backward)(const BlendBackwardArgs<T>&, int tile, double* background);
  /// Fills the derivatives by Gaussians [begin, end); adds those by the pose to `pose[6]`.
  void (*project_backward)(const ProjectBackwardArgs<T>&, std::int64_t begin, std::int64_t end,
                           double* pose);
};

RasterKernels<float> generic_float_kernels();
RasterKernels<double> generic_double_kernels();
RasterKernels<float> avx2_kernels();    // in builds for x86-64
RasterKernels<float> avx512_kernels();  // in builds for x86-64

}  // namespace apvi::splat
