// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "imu/preintegration.hpp"
#include "vio/factors/factors.hpp"
#include "vio/marginalization/marginalization.hpp"
#include "vio/window/calibration.hpp"
#include "vio/window/frame_state.hpp"
#include "vio/window/observation.hpp"

namespace apvi::vio {

/// A gated DVL measurement, corrected for scale and time offset.
struct DvlMeasurement {
  Stamp stamp;
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< in the DVL frame, scale-corrected [m/s]
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();
  std::optional<Eigen::Vector3d> predicted = std::nullopt;  ///< by the window, before the ping
};

/// A pressure-depth measurement.
struct PressureDepthMeasurement {
  Stamp stamp;
  double depth_m = 0.0;
  double sigma_m = 0.01;
};

/// A frame of the window. The addresses of its state do not change during its lifetime.
struct Frame {
  Stamp stamp;        ///< of the state: `image_stamp` less `motion.compensated_s`
  Stamp image_stamp;  ///< by the rig's time offset of the camera
  ImageMotion motion;
  FrameState state;
  FirstEstimate first;
  bool frozen = false;
  std::shared_ptr<imu::Preintegration> from_previous;  ///< null: not linked to the previous frame
  struct Ping {
    DvlMeasurement measured;
    DvlPing factor;
  };
  std::vector<Ping> pings;  ///< between this frame and the next
  bool uses_pings = false;
  /// Measured pressure depth, extrapolated to the stamp of the frame.
  std::optional<PressureDepthMeasurement> depth;
  std::shared_ptr<const Prior> state_prior;  ///< while the window is frozen
  int tracks = 0;                            ///< number of tracks of the first camera
  bool vision_excluded = false;              ///< its observations are excluded from the graph
};

/// A landmark, anchored in the first frame of the window that observes it.
struct Landmark {
  struct Observation {
    Frame* frame = nullptr;
    int camera = 0;
    ReprojectionFactor::View view;
    int track_length = 1;
  };
  std::vector<Observation> observations;  ///< in order of time; the first is the anchor
  double inverse_depth = 0.0;             ///< in the anchor camera [1/m]; 0: not triangulated
  bool frozen = false;

  bool triangulated() const { return inverse_depth > 0.0; }
};

/// The sliding window: all estimated states. Frames in order of time, the newest last.
struct Window {
  std::vector<std::unique_ptr<Frame>> frames;
  std::map<std::int64_t, Landmark> landmarks;
  std::set<std::int64_t> rejected_tracks;  ///< rejected as outliers
  std::shared_ptr<const Prior> prior;
  std::shared_ptr<const Prior> calibration_hold;  ///< see CalibrationHold; may be null
  Calibration calibration;
  std::optional<double> depth_zero_m;  ///< measured depth at z = 0; nullopt: not measured

  Frame& newest() { return *frames.back(); }
  const Frame& newest() const { return *frames.back(); }
};

/// Ray of an observation in its camera, z = 1.
Eigen::Vector3d ray(const Landmark::Observation& observation, const Window& window);
/// T_world_camera of an observation.
SE3 camera_pose(const Landmark::Observation& observation, const Window& window);
/// True if the landmark is part of the graph.
bool is_in_graph(const Landmark& landmark, int min_observations);
/// Position of a landmark in the world [m]; it must be triangulated.
Eigen::Vector3d position(const Landmark& landmark, const Window& window);

/// Without frames, with the rig's calibration.
Window empty_window(const Rig& rig);

/// Adds the observations of a frame, which must be in the window, to the landmarks.
void add_observations(Window& window, Frame& frame, const TrackedFrame& tracked);
/// Removes the observations of a frame; landmarks anchored in it are re-anchored in their next
/// frame.
void remove_observations(Window& window, const Frame& frame);
/// Includes the observations of excluded frames again, except for tracks that the newest frame does
/// not observe: tracks that started and ended in turbid water are likely outliers.
void restore_excluded_frames(Window& window);
/// Triangulates landmarks whose rays have a parallax of at least `min_parallax` [rad].
void triangulate(Window& window, double min_parallax);
/// Multiplies the positions of the first camera and the depths of landmarks; for a window without
/// velocities and prior.
void scale_lengths(Window& window, double factor);
/// Removes a frame without marginalization; the next frame is unlinked from the previous one.
void remove_frame(Window& window, std::size_t index);
/// Removes landmarks without observations.
void remove_unobserved(Window& window);

}  // namespace apvi::vio
