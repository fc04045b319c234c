// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "gaussians/render/tone_curve.hpp"
#include "map_io/origin.hpp"
#include "map_io/ply_header.hpp"
#include "medium/medium.hpp"

namespace apvi::map_io {

/// Comment lines of a PLY header with the local origin (unless zero), the tone curve (unless
/// linear) and the medium.
std::string comment_lines(const std::optional<medium::Medium>& medium, const Origin& origin,
                          const gaussians::ToneCurve& curve);
/// The medium in the comments, float32; nothing when there is none.
std::optional<medium::Medium> medium_of(const PlyHeader& header);
/// The local origin in the comments; zero when there is none.
Origin origin_of(const PlyHeader& header);
/// The tone curve in the comments; linear when there is none.
gaussians::ToneCurve tone_curve_of(const PlyHeader& header);

}  // namespace apvi::map_io
