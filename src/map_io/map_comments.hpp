// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "gaussians/render/tone_curve.hpp"
#include "map_io/origin.hpp"
#include "map_io/ply.hpp"
#include "map_io/ply_header.hpp"
#include "medium/medium.hpp"

namespace apvi::map_io {

/// Comment lines of a PLY header with the local origin (unless zero), the tone curve (unless
/// linear), the vignetting (unless none) and the medium.
std::string comment_lines(const std::optional<medium::Medium>& medium, const Origin& origin,
                          const CameraResponse& camera);
/// The medium in the comments, float32; nothing when there is none.
std::optional<medium::Medium> medium_of(const PlyHeader& header);
/// The local origin in the comments; zero when there is none.
Origin origin_of(const PlyHeader& header);
/// The tone curve and vignetting in the comments; linear and none when there are none.
CameraResponse camera_response_of(const PlyHeader& header);

}  // namespace apvi::map_io
