// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <filesystem>
#include <optional>

#include "apvi/splat/gaussians.hpp"
#include "apvi/splat/medium.hpp"

namespace apvi::splat {

/// Maps as PLY files with the attributes of the reference implementation of 3-D Gaussian splatting,
/// which splat viewers read: x y z, nx ny nz (zero), f_dc_0…2, f_rest_* (all coefficients of red,
/// then of green, then of blue), opacity (logit), scale_0…2 (logarithm), rot_0…3 (w x y z).
/// Everything is float32 on the CPU.

/// Reads a map. Properties may come in any order and of any type, others are skipped; ASCII and
/// both byte orders. Gaussians that nobody could draw (not finite, zero quaternion) are dropped,
/// with a warning that counts them. Throws InputError naming file and line (or vertex) for a file
/// that is no PLY, lacks a property, or is shorter than its header claims, before memory for that
/// claim is taken.
Gaussians read_ply(const std::filesystem::path& path);

/// Writes a map; the water goes into the header's comments (beta_d, beta_b [1/m], b_inf, RGB; the
/// numbers of a lamp, see `to_numbers`). The file appears in one step. Throws RunError when it
/// cannot be written, c10::Error when shapes do not fit.
void write_ply(const std::filesystem::path& path, const Gaussians& gaussians,
               const std::optional<Medium>& medium = std::nullopt);

/// The water in the comments of a map, float32; nothing when there is none. Throws InputError.
std::optional<Medium> read_ply_medium(const std::filesystem::path& path);
/// Writes the water as JSON: {"beta_d": [r, g, b], "beta_b": …, "b_inf": …}, and "lamp" if there is
/// one.
void write_medium_json(const std::filesystem::path& path, const Medium& medium);

/// Points with colours in [0, 1], as an initial map is made of.
struct PointCloud {
  torch::Tensor positions;  ///< [N,3] float32 [m]
  torch::Tensor colors;     ///< [N,3] float32 RGB
};
/// Reads the points of a PLY file: of a point cloud (x y z and red green blue, grey without), or
/// the centres and constant colours of a map. Throws InputError as `read_ply` does.
PointCloud read_ply_points(const std::filesystem::path& path);

/// The constant coefficient of spherical harmonics from a colour, and back.
torch::Tensor color_to_sh_dc(const torch::Tensor& color);
torch::Tensor sh_dc_to_color(const torch::Tensor& sh_dc);

}  // namespace apvi::splat
