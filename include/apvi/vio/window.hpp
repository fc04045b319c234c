// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "apvi/imu/preintegration.hpp"
#include "apvi/vio/factors.hpp"
#include "apvi/vio/frame_state.hpp"
#include "apvi/vio/marginalization.hpp"
#include "apvi/vio/observation.hpp"

namespace apvi::vio {

/// A DVL measurement that has been gated, scaled and put on the true clock by whoever knows how.
struct DvlMeasurement {
  Stamp stamp;
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< DVL frame, true scale [m/s]
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();
};

/// Depth as measured.
struct DepthMeasurement {
  Stamp stamp;
  double depth_m = 0.0;
  double sigma_m = 0.01;
};

/// One moment of the window. Addresses of the state stay while it lives.
struct Frame {
  Stamp stamp;
  FrameState state;
  FirstEstimate first;
  bool frozen = false;
  std::shared_ptr<imu::Preintegration> from_previous;  ///< null: not linked to the frame before
  struct Ping {
    DvlMeasurement measured;
    DvlPing factor;
  };
  std::vector<Ping> pings;  ///< between this frame and the next
  bool takes_pings = false;
  /// As it would have been measured at its instant.
  std::optional<DepthMeasurement> depth;
  std::shared_ptr<const Prior> lean;  ///< what the aid says of the state while the window is frozen
  int tracks = 0;                     ///< that it was seen with
  bool doubtful = false;              ///< its picture is not believed: sightings in it do not count
};

/// A point of the world, anchored in the first frame of the window that sees it.
struct Landmark {
  struct Sighting {
    Frame* frame = nullptr;
    int camera = 0;
    ReprojectionFactor::View view;
    int track_length = 1;
  };
  std::vector<Sighting> sightings;  ///< in order of time; the first is the anchor
  double inverse_depth = 0.0;       ///< in the anchor's camera [1/m]; 0: not known yet
  bool frozen = false;

  bool triangulated() const { return inverse_depth > 0.0; }
};

/// Everything that is estimated together. Frames in order of time, the newest last.
struct Window {
  std::vector<std::unique_ptr<Frame>> frames;
  std::map<std::int64_t, Landmark> landmarks;
  std::set<std::int64_t> given_up;  ///< tracks that are no longer believed
  std::shared_ptr<const Prior> prior;
  std::vector<PoseBlock> T_body_camera;
  std::optional<double> depth_zero_m;  ///< depth that is measured where z = 0; none measured: none
  double time_offset_s = 0.0;          ///< of the cameras, besides the rig's

  Frame& newest() { return *frames.back(); }
  const Frame& newest() const { return *frames.back(); }
};

/// T_world_camera of the camera and frame that saw it.
SE3 camera_pose(const Landmark::Sighting& sighting, const Window& window);
/// Whether a landmark is part of the graph.
bool takes_part(const Landmark& landmark, int min_sightings);
/// Where a landmark is in the world [m]; it must be triangulated.
Eigen::Vector3d position(const Landmark& landmark, const Window& window);

/// Adds the frame's sightings to the landmarks; the frame must be in the window.
void add_sightings(Window& window, Frame& frame, const TrackedFrame& tracked);
/// Takes the frame's sightings out again; landmarks it anchored move on to their next frame.
void remove_sightings(Window& window, const Frame& frame);
/// Believes the pictures of all frames again, except for tracks that the newest frame does not see:
/// what was followed through silt and then lost was silt.
void end_doubt(Window& window);
/// Gives a depth to every landmark whose rays meet under `min_parallax` [rad] at least.
void triangulate(Window& window, double min_parallax);
/// The frame leaves without a trace; the one behind it is no longer linked to what was before.
void remove_frame(Window& window, std::size_t index);
/// Landmarks without sightings are forgotten.
void remove_unseen(Window& window);

}  // namespace apvi::vio
