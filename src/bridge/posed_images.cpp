// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/bridge/posed_images.hpp"

#include <fmt/format.h>

#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <utility>

#include "apvi/bridge/camera_conversion.hpp"
#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/mapping/picture_content.hpp"
#include "apvi/sensors/rig.hpp"

namespace apvi::bridge {
namespace {

constexpr double kLongestGap = 0.1;  // [s] between two poses that one is interpolated from

Trajectory given_poses(const RunConfig& config, const io::SequenceReader& reader) {
  if (!config.localization.poses.empty()) return io::read_trajectory(config.localization.poses);
  auto reference = reader.reference();
  if (!reference) {
    fail_input("{}: the recording has no reference poses; name a file with localization.poses",
               config.dataset.path);
  }
  return *std::move(reference);
}

CameraCalibration first_camera(const RunConfig& config, const io::SequenceReader& reader) {
  const Rig rig = make_rig(pipeline::rig_of(config, reader.rig()));
  if (rig.cameras.empty()) {
    fail_input("{}: the rig has no cam0; mapping needs its calibration", config.dataset.path);
  }
  return rig.cameras.front();
}

class Loader {
 public:
  Loader(const RunConfig& config, io::SequenceReader& reader)
      : heldout_every_(config.eval.heldout_every),
        camera_(first_camera(config, reader)),
        poses_(given_poses(config, reader)),
        undistort_(camera_.model, config.mapping.image_scale) {
    if (!poses_.has_rotation) {
      fail_input("{}: the given poses have no rotations; a map needs them", config.dataset.path);
    }
    images_.rig = pipeline::rig_of(config, reader.rig());
    images_.camera = camera_.model;
    images_.T_body_camera = camera_.T_body_camera;
    images_.camera_delay = Duration::from_seconds(camera_.time_offset_s);
  }

  void take(const ImageFrame& frame) {
    const std::size_t index = count_++;
    const Stamp taken = frame.stamp - images_.camera_delay;
    const auto T_world_body = poses_.at(taken, Duration::from_seconds(kLongestGap));
    if (!T_world_body) {
      ++images_.without_pose;
      return;
    }
    const auto picture = decode(frame);
    if (!picture) return;
    if (mapping::is_black(picture->image)) {
      if (images_.black++ == 0) log::warning("image {}: black; left out", frame.stamp.ns);
      return;
    }
    if (picture->murky) {
      if (images_.murky++ == 0) log::warning("image {}: murky; left out", frame.stamp.ns);
      return;
    }
    mapping::Keyframe keyframe;
    keyframe.stamp_ns = frame.stamp.ns;
    keyframe.name = std::to_string(frame.stamp.ns);
    keyframe.intrinsics = undistort_.intrinsics();
    keyframe.T_camera_world = to_tensor((*T_world_body * camera_.T_body_camera).inverse());
    keyframe.image = picture->image;
    keyframe.held_out = heldout_every_ > 0 && index % static_cast<std::size_t>(heldout_every_) == 0;
    images_.store.add(std::move(keyframe));
  }

  std::size_t count() const { return count_; }
  PosedImages result() { return std::move(images_); }

 private:
  struct Picture {
    torch::Tensor image;  ///< undistorted
    bool murky = false;
  };

  std::optional<Picture> decode(const ImageFrame& frame) {
    try {
      const cv::Mat raw = frame.decode();
      return Picture{to_tensor(undistort_(raw)), mapping::is_murky(to_tensor(raw))};
    } catch (const RunError& e) {
      if (images_.damaged++ == 0) log::warning("image {}: {}; left out", frame.stamp.ns, e.what());
      return std::nullopt;
    }
  }

  int heldout_every_;
  CameraCalibration camera_;
  Trajectory poses_;
  Undistorter undistort_;
  PosedImages images_;
  std::size_t count_ = 0;
};

void report(const PosedImages& images, std::size_t count, const std::string& path) {
  const auto& store = images.store;
  if (count == 0) fail_input("{}: no images of cam0 in this recording", path);
  if (store.training().empty()) {
    fail_input(
        "{}: none of its {} images can be used: {} without a pose at their time, {} damaged, "
        "{} black, {} murky",
        path, count, images.without_pose, images.damaged, images.black, images.murky);
  }
  if (store.size() < count) {
    log::warning(
        "{} of {} images are left out: {} without a pose at their time, {} damaged, {} black, {} "
        "murky",
        count - store.size(), count, images.without_pose, images.damaged, images.black,
        images.murky);
  }
  const auto& camera = store[0].intrinsics;
  log::info("{} images of {} x {}, {} of them held out", store.size(), camera.width, camera.height,
            store.held_out().size());
}

}  // namespace

PosedImages load_posed_images(const RunConfig& config) {
  if (config.dataset.path.empty()) {
    fail_input("dataset.path: not given; add --set dataset.path=FOLDER");
  }
  const auto reader = io::open_sequence(config.dataset, {"camera"});
  Loader loader(config, *reader);
  while (const auto event = reader->next()) {
    const auto* const frame = std::get_if<ImageFrame>(&*event);
    if (frame != nullptr && frame->camera == 0) loader.take(*frame);
  }
  const std::size_t count = loader.count();
  PosedImages images = loader.result();
  report(images, count, config.dataset.path);
  return images;
}

}  // namespace apvi::bridge
