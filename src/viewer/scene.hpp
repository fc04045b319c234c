// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apvi/geometry/trajectory.hpp"

/// What the viewer shows, without the code that draws it.
namespace apvi::viewer {

enum class Layer {
  seen,      ///< color with the medium
  restored,  ///< color without the medium
  depth,
  alpha,
  normals,
};

/// A cut through the map: what lies between two parallel planes.
struct Section {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  ///< of the planes, unit, in the world
  double offset_m = 0.0;     ///< of the middle between them from the world's origin, along `normal`
  double thickness_m = 1.0;  ///< distance of the planes
};

/// A pinhole camera with square pixels and its principal point in the center of the image, and what
/// of the map it sees.
struct Viewpoint {
  int width = 0;
  int height = 0;
  double focal = 1.0;                    ///< focal length in image heights
  SE3 T_world_camera = SE3::identity();  ///< looks along z, x right, y down
  std::optional<Section> section = {};   ///< nothing: the whole map
};

/// A view as a watcher asks for it.
struct View {
  Viewpoint viewpoint = {};
  Layer layer = Layer::seen;
  double water = 1.0;      ///< of `seen`: factor on both coefficients of the medium, 0 to 2
  double detail_px = 0.0;  ///< details smaller than this may be left out [px]
};

/// Rendered from one view.
struct Rendering {
  cv::Mat color;  ///< [H,W] 8-bit BGR
  cv::Mat depth;  ///< [H,W] float [m] along the optical axis, 0 where empty
  cv::Mat alpha;  ///< [H,W] float
};

/// A pose of the trajectory with the state of the fusion, as in health.csv; empty: unknown.
struct TracePose {
  StampedPose pose;
  std::string state;
};

/// Stamps of the keyframes that a loop closure joins.
struct LoopLine {
  Stamp from;
  Stamp to;
};

inline constexpr std::size_t kBeams = 4;

/// A ping of the DVL, as it is drawn.
struct BeamPing {
  Stamp stamp;                            ///< when it was measured
  std::array<double, kBeams> length_m{};  ///< of the lines along the beams
  std::array<bool, kBeams> valid{};
  std::array<bool, kBeams> measured{};  ///< the length is the range of the beam
};

/// The beams of the DVL.
struct Beams {
  SE3 T_body_dvl = SE3::identity();
  std::array<Eigen::Vector3d, kBeams> directions{};  ///< unit, outward, in the frame of the DVL
  std::vector<BeamPing> pings;
};

/// When a sensor served: spans between outages.
struct SensorTrack {
  std::string name;  ///< "camera", "imu", "dvl", "pressure" or "depth"
  std::vector<std::pair<Stamp, Stamp>> spans;
};

/// What a page needs to know once, beside the images.
struct SceneDescription {
  std::string name;
  bool live = false;       ///< poses follow
  bool can_pause = false;  ///< mapping can be paused
  bool can_save = false;   ///< the map can be saved before the end
  bool medium = false;     ///< the map has a medium
  std::int64_t gaussians = 0;
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();     ///< unit
  Eigen::Vector3d center = Eigen::Vector3d::Zero();  ///< of the map [m]
  double radius_m = 1.0;                             ///< of the map around its center
  double focal = 0.8;                                ///< of the vehicle's camera, as in Viewpoint
  double aspect = 4.0 / 3.0;                         ///< width / height of its image
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  ///< of the map in the recording's coordinates
  SE3 T_body_camera = SE3::identity();
  std::vector<TracePose> trace;
  std::vector<SE3> keyframes;  ///< T_world_body
  std::vector<LoopLine> loops;
  std::optional<Beams> beams;
  std::vector<SensorTrack> sensors;
};

/// What is shown. `render` and `depth` are called from one thread, the others from any thread.
class Scene {
 public:
  Scene() = default;
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;
  virtual ~Scene() = default;

  /// Nothing while there is no map.
  virtual std::optional<Rendering> render(const View& view) = 0;
  /// Depth of the surface at the middle of a pixel [m] along the optical axis; nothing where no
  /// surface is seen.
  virtual std::optional<double> depth(const Viewpoint& viewpoint, int column, int row) = 0;
  /// Changes when the map changes: views at rest are drawn anew then.
  virtual std::uint64_t version() const = 0;
  virtual SceneDescription description() const = 0;
  /// Called when a watcher asks for it, if `description` says that it is possible.
  virtual void pause(bool paused) = 0;
  /// Likewise: saves the map. Returns at once.
  virtual void save() = 0;
};

}  // namespace apvi::viewer
