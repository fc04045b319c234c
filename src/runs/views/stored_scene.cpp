// SPDX-License-Identifier: BSD-3-Clause
#include "runs/views/stored_scene.hpp"

#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "runs/dive_files.hpp"
#include "runs/health_file.hpp"
#include "runs/maps/local_origin.hpp"
#include "runs/views/dive_view.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

constexpr double kConsistent = 0.5;  // length of the mean of unit vectors

Trajectory read_keyframes(const fs::path& run, const map_io::Origin& origin) {
  const fs::path file = run / "keyframes.tum";
  return fs::exists(file) ? to_local(io::read_trajectory(file), origin) : Trajectory{};
}

// A file of the run, empty without it. One of an interrupted run may be incomplete; the map is
// worth seeing all the same.
template <typename Read>
auto read_if_whole(const fs::path& file, const Read& read) -> decltype(read(file)) {
  if (!fs::exists(file)) return {};
  try {
    return read(file);
  } catch (const InputError& error) {
    log::warning("not shown: {}", error.what());
    return {};
  }
}

// Every pose has the state of the last frame before it.
std::vector<viewer::TracePose> trace_of(const Trajectory& path,
                                        const std::vector<HealthRow>& health) {
  std::vector<viewer::TracePose> trace;
  std::size_t next = 0;
  for (const StampedPose& pose : path.poses) {
    while (next < health.size() && health[next].stamp.ns <= pose.stamp.ns) ++next;
    trace.push_back({pose, next == 0 ? "" : health[next - 1].state});
  }
  return trace;
}

// Where the top of the images points on average, when most agree.
std::optional<Eigen::Vector3d> camera_up(const Trajectory& path, const SE3& T_body_camera) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const StampedPose& pose : path.poses) {
    sum -= (pose.T_world_body * T_body_camera).rotation * Eigen::Vector3d::UnitY();
  }
  const Eigen::Vector3d mean = sum / std::max(1.0, static_cast<double>(path.size()));
  if (mean.norm() < kConsistent) return std::nullopt;
  return mean.normalized();
}

Eigen::Vector3d world_up(const RunConfig& config) {
  return -make_rig(config.rig).gravity(1.0);
}

std::string name_of(const fs::path& source) {
  const fs::path path = fs::absolute(source).lexically_normal();
  const fs::path name = path.has_filename() ? path.filename() : path.parent_path().filename();
  return (fs::is_directory(source) ? name : name.stem()).string();
}

}  // namespace

void describe_camera(const CameraMount& mount, viewer::SceneDescription& description) {
  const gaussians::Intrinsics& k = mount.intrinsics;
  description.focal = k.fy / k.height;
  description.aspect = static_cast<double>(k.width) / k.height;
  description.T_body_camera = mount.T_body_camera;
}

StoredScene::StoredScene(const fs::path& source, bool with_levels) {
  StoredMap stored = load_drawable_map(source);
  const MapExtent extent = extent_of(stored.map);
  viewer::SceneDescription& d = description_;
  d.name = name_of(source);
  d.medium = extent.medium;
  d.gaussians = extent.gaussians;
  d.center = extent.center;
  d.radius_m = extent.radius_m;
  d.origin = {stored.origin[0], stored.origin[1], stored.origin[2]};
  // The maps of other programs have the y axis of the first camera, which points down.
  if (!stored.map.medium) d.up = -Eigen::Vector3d::UnitY();
  std::vector<gaussians::View> views;
  if (fs::is_directory(source)) views = describe_run(source, stored.origin);
  painter_.set_map(std::move(stored.map), std::move(views), with_levels);
}

std::vector<gaussians::View> StoredScene::describe_run(const fs::path& run,
                                                       const map_io::Origin& origin) {
  const RunConfig& config = config_.emplace(load_recorded_run_config(run / "resolved.yaml"));
  const CameraMount mount = mount_of_run(config);
  describe_camera(mount, description_);
  const Trajectory path = to_local(load_path(run), origin);
  description_.trace = trace_of(path, read_if_whole(run / "health.csv", read_health));
  description_.loops = shown_loops(read_if_whole(run / kLoopsFile, read_loops));
  description_.sensors = shown_sensors(read_if_whole(run / kSensorsFile, read_sensor_spans));
  const auto up = config.localization.enabled ? std::nullopt : camera_up(path, mount.T_body_camera);
  description_.up = up ? *up : world_up(config);
  std::vector<gaussians::View> views;
  for (const StampedPose& pose : read_keyframes(run, origin).poses) {
    description_.keyframes.push_back(pose.T_world_body);
    views.push_back(view_at(pose.T_world_body, mount));
  }
  return views;
}

viewer::SceneDescription StoredScene::description() const {
  const std::scoped_lock lock(mutex_);
  return description_;
}

bool StoredScene::load_beams(const std::function<bool()>& interrupted) {
  auto beams = config_ ? read_beams(*config_, interrupted) : std::nullopt;
  if (!beams) return false;
  const std::scoped_lock lock(mutex_);
  description_.beams = std::move(beams);
  return true;
}

}  // namespace apvi::runs
