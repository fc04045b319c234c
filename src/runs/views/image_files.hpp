// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <filesystem>

namespace apvi::runs {

/// Image files are written atomically; all throw RunError with the file name on failure.

/// 8-bit PNG of an RGB image [H,W,3], uint8 or float in [0, 1] (clamped).
void write_png(const std::filesystem::path& path, const torch::Tensor& image);
/// 16-bit PNG of an RGB image [H,W,3], float in [0, 1] (clamped).
void write_png_16(const std::filesystem::path& path, const torch::Tensor& image);
/// 16-bit PNG of a depth image [H,W] in millimeters; 0 is unknown, the maximum is 65.535 m.
void write_depth_png(const std::filesystem::path& path, const torch::Tensor& depth_m);
/// PFM (little-endian float32) of an RGB image [H,W,3] or a depth image [H,W].
void write_pfm(const std::filesystem::path& path, const torch::Tensor& image);
/// OpenEXR (float32) of an RGB image [H,W,3] or a depth image [H,W].
void write_exr(const std::filesystem::path& path, const torch::Tensor& image);

}  // namespace apvi::runs
