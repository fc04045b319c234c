// SPDX-License-Identifier: BSD-3-Clause
#include "runs/quality/all_images_report.hpp"

#include <algorithm>
#include <iterator>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/sensors/rig.hpp"
#include "io/recorded_images.hpp"
#include "mapping/evaluation.hpp"
#include "runs/maps/stored_map.hpp"
#include "slam/camera_conversion.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

constexpr double kMaxPoseGap_s = 0.1;  // between two poses used for interpolation

/// Camera 0 as self-calibration left it, with the lens that images of the map are undistorted by.
CameraCalibration calibrated_camera(const config::Node& rig, const fs::path& run) {
  CameraCalibration camera = make_rig(rig).cameras.front();
  const fs::path estimated = run / "rig_estimated.yaml";
  if (!fs::exists(estimated)) return camera;
  const CameraCalibration moved = make_rig(config::load_file(estimated)).cameras.front();
  camera.T_body_camera = moved.T_body_camera;
  camera.time_offset_s = moved.time_offset_s;
  return camera;
}

/// Every how many images of the recording one is compared.
std::size_t stride_of(const RunConfig& config, std::size_t poses) {
  const auto every = static_cast<std::size_t>(config.eval.heldout_every);
  const auto most = static_cast<std::size_t>(config.mapping.online.max_heldout_views);
  return every * std::max<std::size_t>(1, (poses / every + most - 1) / most);
}

class Comparison {
 public:
  Comparison(const mapping::Map& map, const mapping::KeyframeStore& keyframes,
             const RunConfig& config, const config::Node& rig, const fs::path& run)
      : map_(map),
        keyframes_(keyframes),
        path_(load_path(run)),
        stride_(stride_of(config, path_.poses.size())),
        camera_(calibrated_camera(rig, run)),
        undistort_(camera_.model, config.mapping.image_scale) {}

  void add(const ImageFrame& frame) {
    if (number_++ % stride_ != 0) return;
    ++images_;
    const Stamp taken = frame.stamp - Duration::from_seconds(camera_.time_offset_s);
    const auto T_world_camera = camera_pose(taken);
    if (!T_world_camera) {
      ++without_pose_;
      return;
    }
    try {
      compare(frame, taken, *T_world_camera);
    } catch (const RunError&) {
      ++unreadable_;
    }
  }

  eval::Json result() const {
    eval::Json json = {
        {"images", images_}, {"without_pose", without_pose_}, {"unreadable", unreadable_}};
    const std::size_t compared = images_ - without_pose_ - unreadable_;
    if (compared > 0) json["psnr_db"] = psnr_db_ / static_cast<double>(compared);
    return json;
  }

 private:
  /// From the nearest keyframe of the map on, by the path. So the calibration is that of its time.
  std::optional<SE3> camera_pose(Stamp taken) const {
    const auto& by_stamp = keyframes_.by_stamp();
    if (by_stamp.empty()) return std::nullopt;
    auto nearest = by_stamp.lower_bound(taken.ns);
    if (nearest == by_stamp.end()) --nearest;
    if (nearest != by_stamp.begin() &&
        taken.ns - std::prev(nearest)->first < nearest->first - taken.ns)
      --nearest;
    const Duration gap = Duration::from_seconds(kMaxPoseGap_s);
    const auto from = path_.at(Stamp{nearest->first}, gap);
    const auto to = path_.at(taken, gap);
    if (!from || !to) return std::nullopt;
    const SE3 T_world_keyframe = slam::to_se3(keyframes_[nearest->second].T_camera_world).inverse();
    const SE3& mount = camera_.T_body_camera;
    return T_world_keyframe * (*from * mount).inverse() * (*to * mount);
  }

  void compare(const ImageFrame& frame, Stamp taken, const SE3& T_world_camera) {
    mapping::Keyframe keyframe;
    keyframe.stamp_ns = taken.ns;
    keyframe.name = std::to_string(taken.ns);
    keyframe.intrinsics = undistort_.intrinsics();
    keyframe.T_camera_world = slam::to_tensor(T_world_camera.inverse());
    keyframe.image = slam::to_tensor(undistort_(frame.decode()));
    if (frame.mask) keyframe.scene = slam::scene_of(undistort_.mask(frame.mask()));
    keyframe.held_out = true;
    mapping::KeyframeStore with_image = keyframes_;
    with_image.add(std::move(keyframe));
    psnr_db_ += mapping::mean_psnr(map_, with_image, {with_image.size() - 1}).value_or(0.0);
  }

  const mapping::Map& map_;
  const mapping::KeyframeStore& keyframes_;
  Trajectory path_;
  std::size_t stride_;
  CameraCalibration camera_;
  slam::Undistorter undistort_;
  double psnr_db_ = 0.0;    ///< sum
  std::size_t number_ = 0;  ///< of the recording's images
  std::size_t images_ = 0;  ///< of them to be compared
  std::size_t without_pose_ = 0;
  std::size_t unreadable_ = 0;
};

}  // namespace

void add_all_images(const mapping::Map& map, const mapping::KeyframeStore& keyframes,
                    const RunConfig& config, const fs::path& run, eval::Json& json) {
  if (config.eval.heldout_every == 0) return;
  try {
    const auto reader = io::open_sequence(config.dataset, {"camera"});
    Comparison comparison(map, keyframes, config, resolve_rig(config, reader->rig()), run);
    io::for_each_image(*reader, 0, [&comparison](const ImageFrame& frame) {
      comparison.add(frame);
      return true;
    });
    json["all_images"] = comparison.result();
  } catch (const Error& error) {
    log::warning("the map is not compared with images all along the run: {}", error.what());
  }
}

}  // namespace apvi::runs
