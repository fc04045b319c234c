// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>

namespace apvi::io {

/// Reads an image file as 8-bit grey or BGR. Throws RunError when it is damaged or no image.
cv::Mat decode_image_file(const std::filesystem::path& path);

}  // namespace apvi::io
