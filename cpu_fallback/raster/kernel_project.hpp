// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "cpu_fallback/raster/raster_kernels.hpp"
#include "gaussians/render/sh_math.hpp"
#include "gaussians/render/splat.hpp"

/// Projection of Gaussians and its derivative, kWidth Gaussians at a time. V is a vector of simd_*.
namespace apvi::gaussians {

/// A camera with every value broadcast to all lanes.
template <typename V>
Camera<V> broadcast_camera(const Camera<typename V::Scalar>& camera) {
  static_assert(sizeof(Camera<V>) == sizeof(camera) / sizeof(typename V::Scalar) * sizeof(V));
  Camera<V> out = {};
  const auto all = [](const auto& from, auto& to) {
    for (int i = 0; i < static_cast<int>(sizeof(to) / sizeof(to[0])); ++i) to[i] = V(from[i]);
  };
  all(camera.R, out.R);
  all(camera.t, out.t);
  all(camera.center, out.center);
  out.fx = V(camera.fx);
  out.fy = V(camera.fy);
  out.cx = V(camera.cx);
  out.cy = V(camera.cy);
  out.x_min = V(camera.x_min);
  out.x_max = V(camera.x_max);
  out.y_min = V(camera.y_min);
  out.y_max = V(camera.y_max);
  out.near_m = V(camera.near_m);
  out.low_pass = V(camera.low_pass);
  return out;
}

/// Gaussians of a batch: [first, first + count), count <= kWidth.
struct Batch {
  std::int64_t first;
  int count;
};

/// Loads columns [begin, begin + width) of kWidth rows as vectors; width <= kWidth, but `out` has
/// room for kWidth. `row_of(lane)` is the start of a row, or null for a row of zeros.
template <typename V, typename F>
void load_columns(F&& row_of, int begin, int width, V* out) {
  for (int lane = 0; lane < V::kWidth; ++lane) {
    const auto* const row = row_of(lane);
    out[lane] = row != nullptr ? V::load_partial(row + begin, width) : V(0);
  }
  V::transpose(out);
}

/// The inverse; null rows are skipped. Overwrites `values`.
template <typename V, typename F>
void store_columns(V* values, int begin, int width, F&& row_of) {
  V::transpose(values);
  for (int lane = 0; lane < V::kWidth; ++lane) {
    auto* const row = row_of(lane);
    if (row != nullptr) values[lane].store_partial(row + begin, width);
  }
}

/// Loads rows of N scalars (small N) as N vectors; lanes beyond the batch repeat its last row.
template <int N, typename V>
void load_rows(const typename V::Scalar* rows, Batch batch, V* out) {
  constexpr int kWidth = V::kWidth;
  alignas(64) typename V::Scalar columns[N][kWidth];
  for (int lane = 0; lane < kWidth; ++lane) {
    const auto* const row =
        rows + (batch.first + (lane < batch.count ? lane : batch.count - 1)) * N;
    for (int k = 0; k < N; ++k) columns[k][lane] = row[k];
  }
  for (int k = 0; k < N; ++k) out[k] = V::load(columns[k]);
}

/// The inverse; lanes beyond the batch are skipped.
template <int N, typename V>
void store_rows(const V* values, Batch batch, typename V::Scalar* rows) {
  alignas(64) typename V::Scalar columns[N][V::kWidth];
  for (int k = 0; k < N; ++k) values[k].store(columns[k]);
  for (int lane = 0; lane < batch.count; ++lane) {
    for (int k = 0; k < N; ++k) rows[(batch.first + lane) * N + k] = columns[k][lane];
  }
}

/// e^x, clamped to the range of float; NaN is preserved.
template <typename V>
V exponential(V x) {
  return exp2(clamp_max(V(127), clamp_min(V(-126), x * V(kLog2E))));
}

/// Prefetches rows [begin, end) of `size` scalars each.
template <typename V, bool ToWrite = false>
void prefetch_rows(const typename V::Scalar* rows, std::int64_t begin, std::int64_t end, int size) {
  constexpr int kLine = 64 / static_cast<int>(sizeof(typename V::Scalar));
  for (std::int64_t i = begin * size; i < end * size; i += kLine) {
    __builtin_prefetch(rows + i, ToWrite ? 1 : 0);
  }
}

/// Values of a batch that both passes need.
template <typename V>
struct ProjectedGaussian {
  V mean[3];
  Projection<V> f;
  V opacity;        // opacity parameter
  V opacity_scale;  // anti-aliasing factor
};

template <typename V>
ProjectedGaussian<V> project_gaussian(const ProjectArgs<typename V::Scalar>& a,
                                      const Camera<V>& camera, Batch batch) {
  ProjectedGaussian<V> out = {};
  V scales[3];
  V quaternion[4];
  V logit(0);
  load_rows<3>(a.means, batch, out.mean);
  load_rows<3>(a.log_scales, batch, scales);
  load_rows<4>(a.quaternions, batch, quaternion);
  load_rows<1>(a.logit_opacities, batch, &logit);
  for (V& s : scales) s = exponential(s);
  out.f = project(camera, out.mean, scales, quaternion);
  out.opacity = V(1) / (V(1) + exponential(V(0) - logit));
  out.opacity_scale = a.antialiased ? sqrt(out.f.det_orig / out.f.det) : V(1);
  return out;
}

/// Space for the coefficients beyond the constant one, in whole vectors.
inline constexpr int kShColumns = 48;

/// Loads these coefficients, three channels interleaved. Rows of Gaussians whose bit in `lanes` is
/// not set are not read.
template <typename V>
void load_sh(const ProjectArgs<typename V::Scalar>& a, Batch batch, unsigned lanes, V* out) {
  const int columns = 3 * sh_rest_used(a.sh_degree);
  const auto row_of = [&](int lane) {
    const bool wanted = (lanes >> static_cast<unsigned>(lane) & 1U) != 0;
    return wanted ? a.sh_rest + (batch.first + lane) * 3 * a.sh_rest_count : nullptr;
  };
  for (int begin = 0; begin < columns; begin += V::kWidth) {
    const int width = columns - begin < V::kWidth ? columns - begin : V::kWidth;
    load_columns(row_of, begin, width, out + begin);
  }
}

/// Color before clamping at 0, without the color factor.
template <typename V>
void evaluate_sh(const ProjectArgs<typename V::Scalar>& a, const Camera<V>& camera, const V* mean,
                 Batch batch, unsigned lanes, V* color) {
  load_rows<3>(a.sh_dc, batch, color);
  for (int c = 0; c < 3; ++c) color[c] = fma(color[c], V(kSh0), V(0.5));
  if (a.sh_degree == 0) return;
  V direction[3];
  view_direction(camera, mean, direction);
  V basis[kMaxShRest];
  sh_basis(a.sh_degree, direction[0], direction[1], direction[2], basis);
  V coefficients[kShColumns];
  load_sh(a, batch, lanes, coefficients);
  for (int k = 0; k < sh_rest_used(a.sh_degree); ++k) {
    for (int c = 0; c < 3; ++c) color[c] = fma(basis[k], coefficients[3 * k + c], color[c]);
  }
}

template <typename V>
void project_batch(const ProjectArgs<typename V::Scalar>& a, const Camera<V>& camera, Batch batch) {
  prefetch_rows<V>(a.sh_rest, batch.first, batch.first + batch.count, 3 * a.sh_rest_count);
  const ProjectedGaussian<V> projected = project_gaussian(a, camera, batch);
  V out[16];
  for (int c = 0; c < 3; ++c) out[6 + c] = V(0);
  const V opacity = projected.opacity * projected.opacity_scale;
  auto visible = compute_splat(camera, projected.f, opacity, V(a.width), V(a.height), out);
  if (any(visible)) {
    const unsigned lanes = bits(visible) & ((1U << static_cast<unsigned>(batch.count)) - 1U);
    evaluate_sh(a, camera, projected.mean, batch, lanes, out + 6);
    for (int c = 0; c < 3; ++c) {
      visible = visible & (out[6 + c] < V(1e30)) & (out[6 + c] > V(-1e30));
      out[6 + c] = clamp_min(out[6 + c], V(0));
    }
    if (a.light != nullptr) {
      V light[3];
      load_rows<3>(a.light, batch, light);
      for (int c = 0; c < 3; ++c) out[6 + c] = out[6 + c] * light[c];
    }
  }
  out[15] = select_or_zero(visible, out[15]);
  const auto row_of = [&](int lane) {
    return lane < batch.count ? &a.splats[batch.first + lane].u : nullptr;
  };
  for (int begin = 0; begin < 16; begin += V::kWidth) {
    store_columns(out + begin, begin, V::kWidth, row_of);
  }
}

template <typename V>
void project_range(const ProjectArgs<typename V::Scalar>& a, std::int64_t begin, std::int64_t end) {
  const Camera<V> camera = broadcast_camera<V>(a.camera);
  for (std::int64_t i = begin; i < end; i += V::kWidth) {
    project_batch(a, camera, {i, static_cast<int>(end - i < V::kWidth ? end - i : V::kWidth)});
  }
}

}  // namespace apvi::gaussians
