// SPDX-License-Identifier: BSD-3-Clause
#include "runs/maps/posed_images.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/sensors/rig.hpp"
#include "io/recorded_images.hpp"
#include "mapping/keyframes/image_visibility.hpp"
#include "runs/maps/local_origin.hpp"
#include "sensors/camera_mask.hpp"
#include "slam/camera_conversion.hpp"

namespace apvi::runs {
namespace {

constexpr double kMaxPoseGap_s = 0.1;  // between two poses used for interpolation
constexpr double kSameStamp_s = 1e-3;  // of an image and its own pose

Trajectory given_poses(const RunConfig& config, const io::SequenceReader& reader) {
  if (!config.localization.poses_file.empty())
    return io::read_trajectory(config.localization.poses_file);
  auto reference = reader.reference();
  if (!reference) {
    fail_input("{}: the recording has no reference poses; set localization.poses_file",
               config.dataset.path);
  }
  return *std::move(reference);
}

CameraCalibration first_camera(const RunConfig& config, const io::SequenceReader& reader) {
  const Rig rig = make_rig(runs::resolve_rig(config, reader.rig()));
  if (rig.cameras.empty()) {
    fail_input("{}: the rig has no cam0; mapping requires its calibration", config.dataset.path);
  }
  return rig.cameras.front();
}

const StampedPose* find_pose(const Trajectory& poses, Stamp taken) {
  const auto next = std::lower_bound(
      poses.poses.begin(), poses.poses.end(), taken - Duration::from_seconds(kSameStamp_s),
      [](const StampedPose& pose, Stamp stamp) { return pose.stamp < stamp; });
  const bool found =
      next != poses.poses.end() && next->stamp <= taken + Duration::from_seconds(kSameStamp_s);
  return found ? &*next : nullptr;
}

/// Whether image `number` of a recording is for evaluation.
bool is_held_out(const RunConfig& config, std::size_t number) {
  const int every = config.eval.heldout_every;
  return every > 0 && number % static_cast<std::size_t>(every) == 0;
}

class Loader {
 public:
  Loader(const RunConfig& config, io::SequenceReader& reader, const PosedImageOptions& options)
      : config_(config),
        camera_(first_camera(config, reader)),
        cache_(options.cache),
        only_posed_(options.poses_of_images.has_value()),
        poses_(only_posed_ ? *options.poses_of_images : given_poses(config, reader)),
        undistort_(camera_.model, config.mapping.image_scale) {
    if (!poses_.has_rotation) {
      fail_input("{}: the given poses have no rotations; mapping requires them",
                 config.dataset.path);
    }
    images_.origin = options.origin ? *options.origin : local_origin(poses_);
    poses_ = to_local(std::move(poses_), images_.origin);
    images_.rig = runs::resolve_rig(config, reader.rig());
    images_.camera = camera_.model;
    images_.T_body_camera = camera_.T_body_camera;
    images_.camera_delay = Duration::from_seconds(camera_.time_offset_s);
    if (!camera_.mask.empty()) {
      images_.store.set_mask(slam::scene_of(undistort_.mask(camera_.mask)));
    }
  }

  void add(const ImageFrame& frame) {
    const std::size_t index = number_++;
    const auto T_world_body = pose_of(frame.stamp - images_.camera_delay);
    if (!T_world_body && only_posed_) return;
    ++count_;
    if (!T_world_body) {
      ++images_.missing_pose;
      return;
    }
    const auto decoded = load(frame);
    if (!decoded) return;
    const torch::Tensor& mask = images_.store.mask();
    if (mapping::is_black(decoded->pixels, decoded->scene.defined() ? decoded->scene : mask)) {
      if (images_.black++ == 0) log::warning("image {}: black; skipped", frame.stamp.ns);
      return;
    }
    if (decoded->low_visibility) {
      if (images_.low_visibility++ == 0)
        log::warning("image {}: low visibility; skipped", frame.stamp.ns);
      return;
    }
    mapping::Keyframe keyframe;
    keyframe.stamp_ns = frame.stamp.ns;
    keyframe.name = std::to_string(frame.stamp.ns);
    keyframe.intrinsics = undistort_.intrinsics();
    keyframe.T_camera_world = slam::to_tensor((*T_world_body * camera_.T_body_camera).inverse());
    keyframe.image = decoded->pixels;
    keyframe.scene = decoded->scene;
    keyframe.held_out = is_held_out(config_, index);
    images_.store.add(std::move(keyframe));
  }

  std::size_t count() const { return count_; }
  PosedImages result() { return std::move(images_); }

 private:
  std::optional<SE3> pose_of(Stamp taken) const {
    if (!only_posed_) return poses_.at(taken, Duration::from_seconds(kMaxPoseGap_s));
    const StampedPose* const found = find_pose(poses_, taken);
    return found != nullptr ? std::optional(found->T_world_body) : std::nullopt;
  }

  std::optional<ImageCache::Image> load(const ImageFrame& frame) {
    if (cache_ == nullptr) return decode(frame);
    if (const ImageCache::Image* const known = cache_->find(frame.stamp)) return *known;
    auto image = decode(frame);
    if (image) cache_->keep(frame.stamp, *image);
    return image;
  }

  std::optional<ImageCache::Image> decode(const ImageFrame& frame) {
    try {
      const cv::Mat raw = frame.decode();
      const cv::Mat own = frame.mask ? frame.mask() : cv::Mat();
      return ImageCache::Image{
          slam::to_tensor(undistort_(raw)), slam::scene_of(undistort_.mask(own)),
          mapping::has_low_visibility(slam::to_tensor(raw),
                                      slam::scene_of(combined(camera_.mask, own)))};
    } catch (const RunError& e) {
      if (images_.damaged++ == 0) log::warning("image {}: {}; skipped", frame.stamp.ns, e.what());
      return std::nullopt;
    }
  }

  const RunConfig& config_;
  CameraCalibration camera_;
  ImageCache* cache_;
  bool only_posed_;
  Trajectory poses_;
  slam::Undistorter undistort_;
  PosedImages images_;
  std::size_t number_ = 0;  ///< of the recording's images
  std::size_t count_ = 0;   ///< of those to be used
};

void report(const PosedImages& images, std::size_t count, const std::string& path) {
  const auto& store = images.store;
  if (count == 0) fail_input("{}: the recording has no images of cam0 with a pose", path);
  if (store.training().empty()) {
    fail_input(
        "{}: none of {} images is usable: {} without a pose, {} damaged or of the wrong size, {} "
        "black, {} with low visibility",
        path, count, images.missing_pose, images.damaged, images.black, images.low_visibility);
  }
  if (store.size() < count) {
    log::warning(
        "skipped {} of {} images: {} without a pose, {} damaged or of the wrong size, {} black, {} "
        "with low visibility",
        count - store.size(), count, images.missing_pose, images.damaged, images.black,
        images.low_visibility);
  }
  const auto& camera = store[0].intrinsics;
  log::info("{} images of {} x {}, {} of them held out", store.size(), camera.width, camera.height,
            store.held_out().size());
  const map_io::Origin& o = images.origin;
  if (!map_io::is_zero(o)) log::info("origin of the map: {} {} {} m", o[0], o[1], o[2]);
}

}  // namespace

const ImageCache::Image* ImageCache::find(Stamp stamp) const {
  const auto found = images_.find(stamp.ns);
  return found == images_.end() ? nullptr : &found->second;
}

void ImageCache::keep(Stamp stamp, const Image& image) {
  const std::size_t bytes =
      image.pixels.nbytes() + (image.scene.defined() ? image.scene.nbytes() : 0);
  if (bytes_ + bytes > max_bytes_) return;
  if (images_.emplace(stamp.ns, image).second) bytes_ += bytes;
}

PosedImages load_posed_images(const RunConfig& config, const PosedImageOptions& options) {
  const auto reader = io::open_sequence(config.dataset, {"camera"});
  Loader loader(config, *reader, options);
  io::for_each_image(*reader, 0, [&loader](const ImageFrame& frame) {
    loader.add(frame);
    return true;
  });
  const std::size_t count = loader.count();
  PosedImages images = loader.result();
  report(images, count, config.dataset.path);
  return images;
}

std::vector<ImagePose> list_posed_images(const RunConfig& config, const Trajectory& poses) {
  const auto reader = io::open_sequence(config.dataset, {"camera"});
  const Duration delay = Duration::from_seconds(first_camera(config, *reader).time_offset_s);
  std::vector<ImagePose> images;
  std::size_t number = 0;
  io::for_each_image(*reader, 0, [&](const ImageFrame& frame) {
    const bool held_out = is_held_out(config, number++);
    const StampedPose* const pose = find_pose(poses, frame.stamp - delay);
    if (pose != nullptr) images.push_back({frame.stamp, *pose, held_out});
    return true;
  });
  return images;
}

Trajectory body_poses(const PosedImages& images, const mapping::ViewCorrections& corrections) {
  Trajectory trajectory;
  const mapping::KeyframeStore& store = images.store;
  for (std::size_t i = 0; i < store.size(); ++i) {
    const torch::Tensor delta = corrections.pose_delta(i, /*learn=*/false);
    const SE3 T_camera_world =
        slam::to_se3(mapping::corrected_pose(store[i].T_camera_world, delta));
    trajectory.poses.push_back({Stamp{store[i].stamp_ns} - images.camera_delay,
                                T_camera_world.inverse() * images.T_body_camera.inverse()});
  }
  return to_recording(std::move(trajectory), images.origin);
}

}  // namespace apvi::runs
