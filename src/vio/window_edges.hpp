// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <memory>

#include "apvi/sensors/rig.hpp"
#include "apvi/vio/aid.hpp"
#include "apvi/vio/config.hpp"
#include "apvi/vio/window.hpp"
#include "graph.hpp"

/// What happens at the edges of the window: how frames and measurements enter and leave.
namespace apvi::vio {

Window empty_window(const Rig& rig);

/// The state after an inertial motion.
FrameState predict(const FrameState& from, const imu::Preintegration& motion,
                   const Eigen::Vector3d& gravity);

DvlPing ping_factor(const DvlMeasurement& measured,
                    std::shared_ptr<const imu::Preintegration> since_frame,
                    const Eigen::Vector3d& gyro, const Rig& rig);
/// Where depth below the surface is measured, in the body frame [m].
Eigen::Vector3d depth_lever(const Rig& rig);
/// The depth measured nearest to the frame, carried over to it by its vertical velocity.
std::optional<DepthMeasurement> depth_at(const Frame& frame,
                                         const std::deque<DepthMeasurement>& depths,
                                         double depth_sign);

/// Knowledge of a frame's state: rows of J by [pose tangent, motion], zero residual.
std::shared_ptr<Prior> make_prior(const Frame& frame, const Eigen::MatrixXd& J);
/// What an aid says of a frame whose state was taken from it; heading and position are never taken
/// for better known than `least_sigma`.
std::shared_ptr<Prior> prior_from(const Frame& frame, const Aid& aid, double least_sigma);

/// Error of a sighting in pixels; of a landmark behind the camera, very large.
double reprojection_error_px(const Landmark& landmark, const Landmark::Sighting& sighting,
                             const Window& window, const Rig& rig);
/// Landmarks with a larger mean error, or behind a camera, lose their depth and are noted.
void give_up_outliers(Window& window, const Rig& rig, double max_error_px);
/// Removes what was noted, once nothing points to it any more.
void forget_given_up(Window& window);
double newest_rms_px(const Window& window, const Rig& rig);

/// Whether the newest frame is worth keeping: it sees things from elsewhere than the last keyframe,
/// has lost many of its tracks, or is much later.
bool is_keyframe(const Window& window, const Config& config, const Rig& rig);

/// Information of the newest pose with everything else integrated out: as it is, and with the
/// oldest pose held.
struct Informations {
  Eigen::Matrix<double, 6, 6> absolute = Eigen::Matrix<double, 6, 6>::Zero();
  Eigen::Matrix<double, 6, 6> over_window = Eigen::Matrix<double, 6, 6>::Zero();
};
Informations newest_informations(const Graph& graph, const Window& window, const Config& config);
/// The oldest frame leaves; what it knew goes into the prior.
void marginalize_oldest(const Graph& graph, Window& window, const Config& config);

}  // namespace apvi::vio
