// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <memory>

#include "apvi/sensors/rig.hpp"
#include "apvi/vio/config.hpp"
#include "vio/state_prior.hpp"
#include "vio/window/graph.hpp"
#include "vio/window/window.hpp"

/// Updates of the window: how frames and measurements enter and leave.
namespace apvi::vio {

/// The state after an inertial motion.
FrameState predict(const FrameState& from, const imu::Preintegration& motion,
                   const Eigen::Vector3d& gravity);

DvlPing ping_factor(const DvlMeasurement& measured,
                    std::shared_ptr<const imu::Preintegration> since_frame,
                    const Eigen::Vector3d& gyro, const Rig& rig);
/// Position of the pressure or depth sensor in the body frame [m].
Eigen::Vector3d pressure_sensor_position(const Rig& rig);
/// The pressure depth measured nearest to the frame, extrapolated to it by the vertical velocity.
std::optional<PressureDepthMeasurement> pressure_depth_at(
    const Frame& frame, const std::deque<PressureDepthMeasurement>& depths, double down_sign);

/// A prior on the state of a frame: rows of J by [pose tangent, motion], zero residual.
std::shared_ptr<Prior> make_prior(const Frame& frame, const Eigen::MatrixXd& J);
/// The prior on a frame whose state was taken from a state prior. `min_sigma` is added to the
/// uncertainty of heading and position.
std::shared_ptr<Prior> make_state_prior(const Frame& frame, const StatePrior& prior,
                                        double min_sigma);

/// Reprojection error of an observation [px]; infinite for landmarks behind the camera.
double reprojection_error_px(const Landmark& landmark, const Landmark::Observation& observation,
                             const Window& window, const Rig& rig);
/// Resets landmarks with a larger mean error, or behind a camera, and records their tracks as
/// rejected.
void reject_outliers(Window& window, const Rig& rig, double max_error_px);
/// The mean reprojection error above which a landmark is an outlier: several times the median of
/// all, at most `max_error_px`. Corners where things at different distances cross (a grating in
/// front of a wall) move like no point does, but by little from image to image.
double outlier_limit_px(const Window& window, const Rig& rig, double max_error_px);
/// Removes the landmarks of rejected tracks, once no term refers to them.
void remove_rejected(Window& window);
double newest_rms_px(const Window& window, const Rig& rig);

/// True if the newest frame is a keyframe: enough parallax, too few surviving tracks, or enough
/// time since the last keyframe.
bool is_keyframe(const Window& window, const Config& config);

/// What all terms but the hold of the calibration tell about the estimated calibration, at its
/// present values.
Prior calibration_knowledge(const Graph& graph, Window& window, const Config& config);

/// Marginal information of the newest pose: absolute, and with the oldest pose held fixed.
struct PoseInformation {
  Eigen::Matrix<double, 6, 6> absolute = Eigen::Matrix<double, 6, 6>::Zero();
  Eigen::Matrix<double, 6, 6> over_window = Eigen::Matrix<double, 6, 6>::Zero();
};
PoseInformation newest_pose_information(const Graph& graph, Window& window, const Config& config);
/// Marginalizes the oldest frame into the prior.
void marginalize_oldest(const Graph& graph, Window& window, const Config& config);

}  // namespace apvi::vio
