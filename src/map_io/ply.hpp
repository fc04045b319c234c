// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <filesystem>
#include <optional>

#include "gaussians/model/gaussians.hpp"
#include "gaussians/model/point_cloud.hpp"
#include "gaussians/render/tone_curve.hpp"
#include "map_io/origin.hpp"
#include "medium/medium.hpp"
#include "medium/vignetting.hpp"

namespace apvi::map_io {

/// Maps as PLY files with the attributes of the reference implementation of 3D Gaussian splatting,
/// as splat viewers read them: x y z, nx ny nz (zero), f_dc_0…2, f_rest_* (all coefficients of red,
/// then green, then blue), opacity (logit), scale_0…2 (logarithm), rot_0…3 (w x y z). Everything is
/// float32 on the CPU.

/// How the camera of a map turns light into image values.
struct CameraResponse {
  gaussians::ToneCurve tone_curve;
  medium::Vignetting vignetting;
};

/// Reads a map, with colors in image values. Properties may come in any order and type, others are
/// skipped, as are other elements; ASCII and both byte orders. `red green blue` replace f_dc_*, a
/// missing scale_2 makes Gaussians flat, and SH coefficients above degree 3 are dropped with a
/// warning. The compressed files of SuperSplat are read as well. An infinite logit is an opacity of
/// zero or one; other Gaussians that are not finite, or have a zero quaternion, are dropped and
/// counted in a warning. Throws InputError naming file and line (or vertex) for a file that is not
/// a PLY file, is a mesh or a point cloud, lacks a property, or is shorter than its header states;
/// the size is checked before memory is allocated.
gaussians::Gaussians read_ply(const std::filesystem::path& path);

/// Writes a map, with the local origin (unless zero), the camera's tone curve (unless linear), its
/// vignetting (unless none) and the medium in the header comments (beta_d, beta_b [1/m], b_inf,
/// RGB; lamp parameters, see `lamp_to_tensor`). Positions are local. Colors are written in image
/// values. The file is replaced atomically. Throws RunError when it cannot be written, c10::Error
/// when shapes do not match.
void write_ply(const std::filesystem::path& path, const gaussians::Gaussians& gaussians,
               const std::optional<medium::Medium>& medium = std::nullopt,
               const Origin& origin = {}, const CameraResponse& camera = {});

/// The medium in the comments of a map, float32; nothing when there is none. Throws InputError.
std::optional<medium::Medium> read_ply_medium(const std::filesystem::path& path);
/// Writes the medium as JSON: {"beta_d": [r, g, b], "beta_b": …, "b_inf": …}, and "lamp" if there
/// is one.
void write_medium_json(const std::filesystem::path& path, const medium::Medium& medium);

/// Reads the points of a PLY file: a point cloud (x y z and red green blue; gray without), or the
/// centers and constant colors of a map. The positions are made relative to `origin` in double
/// precision. Throws InputError as `read_ply` does.
gaussians::PointCloud read_ply_points(const std::filesystem::path& path, const Origin& origin = {});

}  // namespace apvi::map_io
