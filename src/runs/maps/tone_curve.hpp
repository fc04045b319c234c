// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "runs/run_config.hpp"

namespace apvi::runs {

/// Whether cam0 of a recording in a folder has JPEG files. False for bags, whose drivers also
/// compress images of machine-vision cameras.
bool has_jpeg_images(const std::filesystem::path& recording);

/// The configuration with the tone curve of the camera. Cameras that store JPEG or send video make
/// images for viewing: `mapping.tone_curve.kind: auto` becomes srgb for them, and is logged.
RunConfig with_tone_curve(RunConfig config);

}  // namespace apvi::runs
