// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string_view>

#include "apvi/config/node.hpp"

namespace apvi::io {

/// Sets `intrinsics`, `distortion` and `coefficients` of a camera that Kalibr calls ds (xi, alpha,
/// fu, fv, pu, pv), eucm (alpha, beta, fu, fv, pu, pv) or omni (xi, fu, fv, pu, pv). False for any
/// other `camera_model`. Throws InputError for wrong counts, and for distortion on top of it.
///
/// omni is Mei and Rives' unified model. Without distortion it is EUCM with
/// alpha = xi / (1 + xi), beta = 1 and focal lengths divided by 1 + xi.
bool set_sphere_camera(const config::Node& from, std::string_view path, config::Node& camera);

}  // namespace apvi::io
