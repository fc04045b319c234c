// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "gaussians/render/splat.hpp"

/// The inner loops of the CPU rasterizer, compiled once per instruction set. Plain pointers only:
/// the linker might keep a standard library or LibTorch template instantiated here for a wide
/// instruction set as the copy for the whole program.
namespace apvi::gaussians {

/// One splat in one tile. `slot` enumerates these pairs Gaussian by Gaussian: results are written
/// there, so that sums over a Gaussian's tiles have a fixed order, independent of threads.
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
  int sh_degree;      // degree to evaluate
  int width, height;
  bool antialiased;
  Camera<T> camera;
  Splat<T>* splats;  // [count]
};

template <typename T>
struct ProjectBackwardArgs {
  ProjectArgs<T> forward;
  const std::uint32_t* slot_begin;  // [count + 1]
  const T* slot_weight;             // from `blend`
  const T* slot_gradient;  // [slots, kSlotSize]; undefined where the weight is not positive
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
  T* slot_weight;  // [slots] largest blend weight; negative: none, see `blend_splat`
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
  /// Fills the slots of nonzero weight; adds the derivative by the background to `background[3]`.
  void (*blend_backward)(const BlendBackwardArgs<T>&, int tile, double* background);
  /// Fills the gradient of Gaussians [begin, end); adds that of the pose to `pose[6]`.
  void (*project_backward)(const ProjectBackwardArgs<T>&, std::int64_t begin, std::int64_t end,
                           double* pose);
};

RasterKernels<float> generic_float_kernels();
RasterKernels<double> generic_double_kernels();
RasterKernels<float> avx2_kernels();    // in builds for x86-64
RasterKernels<float> avx512_kernels();  // in builds for x86-64

}  // namespace apvi::gaussians
