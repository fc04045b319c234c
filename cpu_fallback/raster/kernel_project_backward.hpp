// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "cpu_fallback/raster/kernel_project.hpp"

/// Backward pass from the sums over pixels to the parameters of kWidth Gaussians at a time.
namespace apvi::gaussians {

/// Sums the slots of each Gaussian, one vector per derivative; returns the bits of the lanes that
/// have any.
template <typename V>
unsigned add_slots(const ProjectBackwardArgs<typename V::Scalar>& a, Batch batch, V* sums) {
  using S = typename V::Scalar;
  alignas(64) S totals[V::kWidth][kSlotSize] = {};
  unsigned lanes = 0;
  for (int lane = 0; lane < batch.count; ++lane) {
    S* const total = totals[lane];
    const std::uint32_t end = a.slot_begin[batch.first + lane + 1];
    for (std::uint32_t slot = a.slot_begin[batch.first + lane]; slot < end; ++slot) {
      if (!(a.slot_weight[slot] > S(0))) continue;
      lanes |= 1U << static_cast<unsigned>(lane);
      const S* const gradient = a.slot_gradient + std::int64_t(slot) * kSlotSize;
      for (int k = 0; k < kSlotSize; ++k) total[k] += gradient[k];
    }
  }
  const auto row_of = [&totals](int lane) { return totals[lane]; };
  for (int begin = 0; begin < kSlotSize; begin += V::kWidth) {
    const int width = kSlotSize - begin < V::kWidth ? kSlotSize - begin : V::kWidth;
    load_columns(row_of, begin, width, sums + begin);
  }
  return lanes;
}

/// Zeros for the Gaussians of a batch that touch no pixel.
template <typename V>
void clear_rows(typename V::Scalar* rows, Batch batch, int size) {
  for (std::int64_t i = batch.first * size; i < (batch.first + batch.count) * size; ++i) {
    rows[i] = typename V::Scalar(0);
  }
}

/// Gradient with respect to the SH coefficients, from that of the color; writes that of the view
/// direction to `direction_gradient`.
template <typename V>
void color_backward(const ProjectBackwardArgs<typename V::Scalar>& a, const V* direction,
                    Batch batch, unsigned lanes, const V* color, V* direction_gradient) {
  const ProjectArgs<typename V::Scalar>& f = a.forward;
  V basis[kMaxShRest];
  V weights[kMaxShRest];
  V columns[kShColumns];
  const int used = sh_rest_used(f.sh_degree);
  sh_basis(f.sh_degree, direction[0], direction[1], direction[2], basis);
  load_sh(f, batch, lanes, columns);
  for (int k = 0; k < used; ++k) {
    weights[k] =
        columns[3 * k] * color[0] + columns[3 * k + 1] * color[1] + columns[3 * k + 2] * color[2];
  }
  sh_basis_backward(f.sh_degree, direction[0], direction[1], direction[2], weights,
                    direction_gradient);
  const auto row_of = [&](int lane) {
    return lane < batch.count ? a.sh_rest + (batch.first + lane) * 3 * f.sh_rest_count : nullptr;
  };
  for (int k = 0; k < kShColumns; ++k) {
    columns[k] = k < 3 * used ? basis[k / 3] * color[k % 3] : V(0);
  }
  for (int begin = 0; begin < 3 * f.sh_rest_count; begin += V::kWidth) {
    const int width = 3 * f.sh_rest_count - begin;
    store_columns(columns + begin, begin, width < V::kWidth ? width : V::kWidth, row_of);
  }
}

/// Gradient with respect to the colors and, through the view direction, to mean and camera pose.
template <typename V>
void view_backward(const ProjectBackwardArgs<typename V::Scalar>& a, const Camera<V>& camera,
                   const ProjectedGaussian<V>& projected, Batch batch, unsigned lanes,
                   const V* sums, ProjectionGradient<V>& g) {
  using S = typename V::Scalar;
  const auto touched = V::mask_of(lanes);
  V color[3];
  V row[3];
  V light[3] = {V(1), V(1), V(1)};
  if (a.forward.light != nullptr) load_rows<3>(a.forward.light, batch, light);
  alignas(64) S splat_color[3][V::kWidth];
  for (int lane = 0; lane < V::kWidth; ++lane) {
    const int i = lane < batch.count ? lane : 0;
    for (int c = 0; c < 3; ++c) splat_color[c][lane] = a.forward.splats[batch.first + i].color[c];
  }
  for (int c = 0; c < 3; ++c) {
    color[c] = select_or_zero(touched & (V::load(splat_color[c]) > V(0)), sums[c] * light[c]);
    row[c] = color[c] * V(kSh0);
  }
  store_rows<3>(row, batch, a.sh_dc);
  if (a.forward.sh_rest_count == 0) return;
  V direction[3];
  const V inverse = view_direction(camera, projected.mean, direction);
  for (V& x : direction) x = select_or_zero(touched, x);
  V grad_direction[3];
  color_backward(a, direction, batch, lanes, color, grad_direction);
  const V along = grad_direction[0] * direction[0] + grad_direction[1] * direction[1] +
                  grad_direction[2] * direction[2];
  for (int i = 0; i < 3; ++i) {
    grad_direction[i] =
        select_or_zero(touched, (grad_direction[i] - along * direction[i]) * inverse);
    g.mean[i] = g.mean[i] + grad_direction[i];
  }
  // A translation of the camera along its axes moves its center in the opposite direction.
  V shift[3];
  rotate(camera.R, grad_direction, shift);
  for (int i = 0; i < 3; ++i) g.pose[i] = g.pose[i] + shift[i];
}

template <typename V>
void clear_batch(const ProjectBackwardArgs<typename V::Scalar>& a, Batch batch) {
  clear_rows<V>(a.means, batch, 3);
  clear_rows<V>(a.log_scales, batch, 3);
  clear_rows<V>(a.quaternions, batch, 4);
  clear_rows<V>(a.logit_opacities, batch, 1);
  clear_rows<V>(a.sh_dc, batch, 3);
  clear_rows<V>(a.sh_rest, batch, 3 * a.forward.sh_rest_count);
  clear_rows<V>(a.mean2d, batch, 1);
}

template <typename V>
void project_batch_backward(const ProjectBackwardArgs<typename V::Scalar>& a,
                            const Camera<V>& camera, Batch batch, double* pose) {
  V sums[16];  // the last ones are padding
  const unsigned lanes = add_slots(a, batch, sums);
  if (lanes == 0) return clear_batch<V>(a, batch);
  const std::int64_t end = batch.first + batch.count;
  const int sh_size = 3 * a.forward.sh_rest_count;
  prefetch_rows<V>(a.forward.sh_rest, batch.first, end, sh_size);
  prefetch_rows<V, true>(a.sh_rest, batch.first, end, sh_size);
  if (batch.count == V::kWidth && end + V::kWidth <= a.forward.count) {
    prefetch_rows<V>(a.slot_gradient, a.slot_begin[end], a.slot_begin[end + V::kWidth], kSlotSize);
  }
  const auto touched = V::mask_of(lanes);
  const ProjectedGaussian<V> projected = project_gaussian(a.forward, camera, batch);
  const FootprintGradient<V> grad_footprint =
      footprint_gradient(camera, projected.f, sums, a.forward.antialiased);
  ProjectionGradient<V> g = project_backward(camera, projected.f, grad_footprint);
  for (V& x : g.mean) x = select_or_zero(touched, x);
  for (V& x : g.pose) x = select_or_zero(touched, x);
  for (V& x : g.log_scale) x = select_or_zero(touched, x);
  for (V& x : g.quaternion) x = select_or_zero(touched, x);
  view_backward(a, camera, projected, batch, lanes, sums, g);
  const V logit = select_or_zero(touched, sums[4] * (V(1) - projected.opacity));
  const V du = grad_footprint.u * V(0.5 * a.forward.width);
  const V dv = grad_footprint.v * V(0.5 * a.forward.height);
  const V mean2d = select_or_zero(touched, sqrt(du * du + dv * dv));
  store_rows<3>(g.mean, batch, a.means);
  store_rows<3>(g.log_scale, batch, a.log_scales);
  store_rows<4>(g.quaternion, batch, a.quaternions);
  store_rows<1>(&logit, batch, a.logit_opacities);
  store_rows<1>(&mean2d, batch, a.mean2d);
  for (int i = 0; i < 6; ++i) {
    alignas(64) typename V::Scalar lane_values[V::kWidth];
    g.pose[i].store(lane_values);
    for (int lane = 0; lane < batch.count; ++lane) pose[i] += double(lane_values[lane]);
  }
}

template <typename V>
void project_range_backward(const ProjectBackwardArgs<typename V::Scalar>& a, std::int64_t begin,
                            std::int64_t end, double* pose) {
  const Camera<V> camera = broadcast_camera<V>(a.forward.camera);
  for (std::int64_t i = begin; i < end; i += V::kWidth) {
    const int count = static_cast<int>(end - i < V::kWidth ? end - i : V::kWidth);
    project_batch_backward(a, camera, {i, count}, pose);
  }
}

}  // namespace apvi::gaussians
