// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "gaussians/render/projection_math.hpp"
#include "gaussians/render/view.hpp"

namespace apvi::gaussians {

/// Renderer camera. `T_camera_world`: 16 values, row-major [m]; `near_m`: near plane;
/// `low_pass_px2`: variance added to the footprint in the image.
template <typename T>
Camera<T> make_camera(const double* T_camera_world, const Intrinsics& k, double near_m,
                      double low_pass_px2) {
  const double* const m = T_camera_world;
  Camera<T> out = {};
  for (int i = 0; i < 3; ++i) {
    out.t[i] = static_cast<T>(m[4 * i + 3]);
    out.center[i] = static_cast<T>(-(m[i] * m[3] + m[4 + i] * m[7] + m[8 + i] * m[11]));
    for (int j = 0; j < 3; ++j) out.R[3 * i + j] = static_cast<T>(m[4 * i + j]);
  }
  const double margin_x = kFieldMargin * 0.5 * k.width;
  const double margin_y = kFieldMargin * 0.5 * k.height;
  out.fx = static_cast<T>(k.fx);
  out.fy = static_cast<T>(k.fy);
  out.cx = static_cast<T>(k.cx);
  out.cy = static_cast<T>(k.cy);
  out.x_min = static_cast<T>(-(k.cx + margin_x) / k.fx);
  out.x_max = static_cast<T>((k.width - k.cx + margin_x) / k.fx);
  out.y_min = static_cast<T>(-(k.cy + margin_y) / k.fy);
  out.y_max = static_cast<T>((k.height - k.cy + margin_y) / k.fy);
  out.near_m = static_cast<T>(near_m);
  out.low_pass = static_cast<T>(low_pass_px2);
  return out;
}

}  // namespace apvi::gaussians
