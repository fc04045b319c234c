// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <opencv2/core/mat.hpp>

#include "apvi/geometry/se3.hpp"
#include "apvi/sensors/camera_model.hpp"
#include "sim/render/shading.hpp"

namespace apvi::sim {

/// Color (red, green, blue) in the image of a particle of albedo `brightness`, by its position in
/// the world and in the camera frame.
using SnowColor = std::function<Eigen::Vector3d(
    const Eigen::Vector3d& p_world, const Eigen::Vector3d& p_camera, double brightness)>;
/// By the image formation model.
SnowColor snow_color(const LightState& light);

/// Draws marine snow into a linear image (CV_32FC3 BGR): particles that drift with the current, as
/// streaks from the first to the last pose of the exposure, occluded where `range` [m] is nearer,
/// and out of focus when close.
void draw_snow(const SnowConfig& config, double time_s, const SnowColor& color,
               const CameraModel& camera, const SE3& T_world_camera_start,
               const SE3& T_world_camera_end, std::uint64_t seed, const cv::Mat& range,
               cv::Mat& linear);

}  // namespace apvi::sim
