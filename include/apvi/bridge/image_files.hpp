// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <filesystem>

namespace apvi::bridge {

/// Image files appear in one step; all throw RunError naming the file when it cannot be written.

/// 8-bit PNG of an RGB image [H,W,3], uint8 or float in [0, 1] (clamped).
void write_png(const std::filesystem::path& path, const torch::Tensor& image);
/// 16-bit PNG of a depth image [H,W] in millimetres; 0 is unknown, 65.535 m the most.
void write_depth_png(const std::filesystem::path& path, const torch::Tensor& depth_m);
/// PFM (little-endian float32) of an RGB image [H,W,3] or a depth image [H,W].
void write_pfm(const std::filesystem::path& path, const torch::Tensor& image);

}  // namespace apvi::bridge
