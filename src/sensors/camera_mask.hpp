// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>
#include <optional>

#include "apvi/config/node.hpp"
#include "apvi/sensors/camera_model.hpp"

/// Masks of cameras and images, as in `CameraCalibration::mask`. An empty one hides nothing.
namespace apvi {

/// Reads a mask: a pixel is the scene if it is brighter than half of the brightest one. Throws
/// RunError if the file is no image.
cv::Mat read_mask(const std::filesystem::path& file);

/// The mask of an image in a folder of masks: of the image's name, of that and ".png" (COLMAP), or
/// with the extension ".png". `image`: relative path.
std::optional<std::filesystem::path> find_mask(const std::filesystem::path& folder,
                                               const std::filesystem::path& image);

/// Reads the mask of a camera. Throws InputError if the file is no image, has another size than the
/// camera's images, or hides all or nothing of them.
cv::Mat load_camera_mask(const std::filesystem::path& file, const CameraModel& camera);

/// Hides what either of two masks of one size hides.
cv::Mat combined(const cv::Mat& a, const cv::Mat& b);

/// The mask of images reduced `by` a whole number. What is within `margin_px` reduced pixels of
/// something hidden is hidden too.
cv::Mat reduced_mask(const cv::Mat& mask, int by, int margin_px);

/// Whether the pixel is hidden; rounded, (0, 0) is the center of the first one.
bool is_hidden(const cv::Mat& mask, const cv::Point2f& pixel);

/// Makes the paths of masks in the nodes of a rig file absolute, if they are relative to it.
void resolve_masks(config::Node& rig, const std::filesystem::path& file);

}  // namespace apvi
