// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "gaussians/device.hpp"
#include "gaussians/render/tone_curve.hpp"
#include "gaussians/render/view.hpp"
#include "mapping/storage/storage_folder.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// An image with its camera pose.
struct Keyframe {
  std::int64_t stamp_ns = 0;
  std::string name;  ///< for files and messages
  gaussians::Intrinsics intrinsics;
  torch::Tensor T_camera_world;  ///< [4,4] float64 on the CPU
  /// [H,W,3] uint8 RGB, without distortion; of those in a store see KeyframeStore::pixels.
  torch::Tensor image;
  bool held_out = false;    ///< for evaluation: never optimized
  std::int64_t number = 0;  ///< of a held-out image, in the recording's order
  bool saturates = false;   ///< contains saturated pixels; set by the store
  /// [H,W] bool, pixels that show the scene; undefined: as `KeyframeStore::set_mask` says.
  torch::Tensor scene = {};
};

/// The keyframes of a map. Images are stored as uint8 on the device, which saves memory and copies,
/// and are converted to float on access.
class KeyframeStore {
 public:
  explicit KeyframeStore(const torch::Device& device = gaussians::active_device())
      : device_(device) {}

  /// A keyframe without an image is stored as a pose only. Throws c10::Error for wrong shapes or
  /// types.
  void add(Keyframe keyframe);

  /// Sets the pose [4,4] float64.
  void set_pose(std::size_t i, const torch::Tensor& T_camera_world);
  /// Drops the image: the keyframe is no longer used for training or evaluation.
  void drop_image(std::size_t i);
  /// Moves all images, and those added later, to `device`.
  void move_images(const torch::Device& device);
  const torch::Device& device() const { return device_; }
  /// Keeps the images of these views, and of no others, off the device. Returns the training views
  /// among those that return to it whose image is lost (see StorageFile); it is dropped.
  std::vector<std::size_t> keep_off_device(const std::set<std::size_t>& views);
  /// Where images off the device go when host memory is full; nullptr: nowhere.
  void set_folder(std::shared_ptr<StorageFolder> folder) { folder_ = std::move(folder); }
  /// Writes images off the device to files, the oldest first, until at most `max_bytes` are in host
  /// memory or there is no room for files.
  void write_host_images(double max_bytes);
  /// Views whose image is in host memory because of `keep_off_device`.
  const std::set<std::size_t>& on_host() const { return on_host_; }
  /// Total size of the images on the device.
  std::size_t image_bytes() const { return image_bytes_; }
  /// Total size of those of `on_host`.
  std::size_t host_image_bytes() const { return host_image_bytes_; }
  /// Number of images that are only in files.
  std::size_t images_on_disk() const;

  std::size_t size() const { return keyframes_.size(); }
  const Keyframe& operator[](std::size_t i) const { return keyframes_.at(i); }
  bool has_image(std::size_t i) const { return keyframes_.at(i).image.defined() || is_on_disk(i); }
  /// The image [H,W,3] uint8, wherever it is kept. Throws RunError when its file is lost.
  torch::Tensor pixels(std::size_t i) const;
  /// Ascending indices of the training and held-out keyframes that have an image.
  const std::vector<std::size_t>& training() const { return training_; }
  const std::vector<std::size_t>& held_out() const { return held_out_; }
  /// Indices of all keyframes by stamp; of keyframes with the same stamp, the newest.
  const std::map<std::int64_t, std::size_t>& by_stamp() const { return by_stamp_; }

  /// The camera's tone curve: linear until set.
  void set_tone_curve(const gaussians::ToneCurve& curve) { tone_curve_ = curve; }
  const gaussians::ToneCurve& tone_curve() const { return tone_curve_; }

  /// The pixels [H,W] bool of all images that show the scene, on any device; see
  /// CameraCalibration::mask. All of them until set, before the first image.
  void set_mask(const torch::Tensor& scene);
  /// That of images without a mask of their own; undefined: none.
  const torch::Tensor& mask() const { return scene_; }
  /// The pixels [H/f,W/f] bool of an image, on `device`, that show nothing but the scene;
  /// undefined: all.
  torch::Tensor scene(std::size_t i, int factor, const torch::Device& device) const;

  /// The image [H/f,W/f,3] float32 in [0, 1] on `device` in linear light, each pixel the mean of
  /// f x f pixels (incomplete blocks at the right and bottom are cropped).
  torch::Tensor image(std::size_t i, int factor, const torch::Device& device) const;
  /// The same in the camera's own image values.
  torch::Tensor image_values(std::size_t i, int factor, const torch::Device& device) const;
  /// The view of the image reduced by `factor`, without pose correction.
  gaussians::View view(std::size_t i, int factor) const;

  /// Returns the files that the archive refers to.
  StorageFiles save(torch::serialize::OutputArchive& archive) const;
  /// Adds the keyframes of an archive; returns the files that it refers to. Throws c10::Error when
  /// it does not match.
  StorageFiles load(torch::serialize::InputArchive& archive);

 private:
  void append(Keyframe keyframe);
  void list_view(std::size_t i);
  bool is_on_disk(std::size_t i) const {
    return !keyframes_.at(i).image.defined() && files_.count(i) != 0;
  }
  torch::Tensor image_on_disk(std::size_t i) const;
  bool read_image(std::size_t i);
  std::size_t move(std::size_t i, const torch::Device& device);

  torch::Device device_;
  std::vector<Keyframe> keyframes_;
  std::vector<std::size_t> training_;
  std::vector<std::size_t> held_out_;
  std::map<std::int64_t, std::size_t> by_stamp_;
  std::set<std::size_t> on_host_;
  /// Of images that are or were only there: they do not change.
  std::map<std::size_t, std::shared_ptr<StorageFile>> files_;
  std::shared_ptr<StorageFolder> folder_;
  std::size_t image_bytes_ = 0;
  std::size_t host_image_bytes_ = 0;
  gaussians::ToneCurve tone_curve_;
  torch::Tensor scene_;  ///< [H,W] bool on the active device, or undefined
};

/// Converts bytes [H,W,3] to float32 in [0, 1] [H/factor,W/factor,3] by averaging blocks, after
/// looking each byte up in `table` [256] (ToneCurve::byte_table) if that is defined. With factor 1
/// the bytes may have any shape.
torch::Tensor to_float_image(const torch::Tensor& bytes, int factor,
                             const torch::Tensor& table = {});

/// Whether a tensor is a finite rigid transform [4,4] float64.
bool is_rigid(const torch::Tensor& T);
/// The inverse of a rigid transform [4,4].
torch::Tensor rigid_inverse(const torch::Tensor& T);
/// Size of a rigid motion [4,4] float64: the larger of its translation [m] and, for small ones, its
/// rotation [rad] times the square root of two.
double motion_size(const torch::Tensor& motion);

/// Center of a camera in the world [m], float64 [3], from T_camera_world [4,4].
torch::Tensor camera_center(const torch::Tensor& T_camera_world);
/// Distance between the centers of two cameras [m], from T_camera_world [4,4] float64 on the CPU.
/// Without tensor operations, because it is done for all keyframes at each new one.
double camera_distance(const torch::Tensor& a, const torch::Tensor& b);

/// Scene extent that scales the learning rate of the means: 1.1 times the largest distance of a
/// training camera from the mean camera center [m] (Kerbl et al., 2023), at least 0.1 m.
double scene_extent(const KeyframeStore& store);
/// The same of all cameras of several stores.
double scene_extent(const std::vector<const KeyframeStore*>& stores);

}  // namespace apvi::mapping
