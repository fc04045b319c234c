// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "apvi/splat/device.hpp"
#include "apvi/splat/view.hpp"

namespace apvi::mapping {

/// A picture and where it was taken.
struct Keyframe {
  std::int64_t stamp_ns = 0;
  std::string name;  ///< for files and messages
  splat::Intrinsics intrinsics;
  torch::Tensor T_camera_world;  ///< [4,4] float64 on the CPU
  torch::Tensor image;           ///< [H,W,3] uint8 RGB, without distortion
  bool held_out = false;         ///< for evaluation: never optimised
  std::int64_t number = 0;       ///< of a held-out one among all that the recording has
  bool saturates = false;        ///< some of the picture is as bright as can be; told by the store
};

/// The pictures that a map is made of. They stay bytes, a twelfth of what they would need as an
/// optimiser sees them with its gradients, and are made numbers when they are asked for. They lie
/// where they are used, so that no step waits for one to be copied.
class KeyframeStore {
 public:
  explicit KeyframeStore(const torch::Device& device = splat::active_device()) : device_(device) {}

  /// One without a picture is a pose to know of and nothing else. Throws c10::Error when shapes or
  /// types do not fit.
  void add(Keyframe keyframe);

  /// The keyframe stands elsewhere [4,4] float64.
  void set_pose(std::size_t i, const torch::Tensor& T_camera_world);
  /// Forgets the picture: nothing is learnt from this keyframe any more, and it is not evaluated.
  void drop_image(std::size_t i);
  /// Keeps all pictures elsewhere, those that come too.
  void move_images(const torch::Device& device);
  const torch::Device& device() const { return device_; }
  /// Of all pictures together.
  std::size_t image_bytes() const { return image_bytes_; }

  std::size_t size() const { return keyframes_.size(); }
  const Keyframe& operator[](std::size_t i) const { return keyframes_.at(i); }
  /// Indices of the keyframes to learn from, and of the others that are kept; in order.
  const std::vector<std::size_t>& training() const { return training_; }
  const std::vector<std::size_t>& held_out() const { return held_out_; }

  /// The picture [H/f,W/f,3] float32 in [0, 1] on `device`, each pixel the mean of f x f (what is
  /// left over at the right and below is cut off).
  torch::Tensor image(std::size_t i, int factor, const torch::Device& device) const;
  /// The camera that sees the picture reduced by `factor`, without pose correction.
  splat::View view(std::size_t i, int factor) const;

 private:
  torch::Device device_;
  std::vector<Keyframe> keyframes_;
  std::vector<std::size_t> training_;
  std::vector<std::size_t> held_out_;
  std::size_t image_bytes_ = 0;
};

/// The numbers 0 to 1 [H/factor,W/factor,3] float32 of a picture's bytes [H,W,3]: means of `factor`
/// pixels each way.
torch::Tensor to_numbers(const torch::Tensor& bytes, int factor);

/// Whether a tensor is a rigid motion [4,4] float64 of finite numbers.
bool is_rigid(const torch::Tensor& T);
/// The inverse of a rigid motion [4,4].
torch::Tensor rigid_inverse(const torch::Tensor& T);

/// Centre of a camera in the world [m], float64 [3], from T_camera_world [4,4].
torch::Tensor camera_center(const torch::Tensor& T_camera_world);

/// What the means' learning rate is measured in: 1.1 times the largest distance of a training
/// camera from their mean [m] (Kerbl et al., 2023), at least 0.1 m.
double scene_extent(const KeyframeStore& store);

}  // namespace apvi::mapping
