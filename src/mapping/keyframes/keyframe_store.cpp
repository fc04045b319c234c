// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/keyframes/keyframe_store.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "apvi/core/error.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::uint8_t kSaturatedByte = 250;    // below 255 because of noise
constexpr double kMinSaturatedFraction = 1e-3;  // of the image's values
constexpr double kMinExtent_m = 0.1;            // for a camera that only rotates

gaussians::Intrinsics reduced(const gaussians::Intrinsics& full, int factor) {
  const double f = 1.0 / factor;
  return {.fx = f * full.fx,
          .fy = f * full.fy,
          .cx = f * full.cx,
          .cy = f * full.cy,
          .width = full.width / factor,
          .height = full.height / factor,
          .lens_spread = full.lens_spread};
}

std::array<double, 3> position_of(const Tensor& T_camera_world) {
  const auto T = T_camera_world.accessor<double, 2>();
  std::array<double, 3> position = {};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto column = static_cast<std::int64_t>(axis);
    for (std::int64_t row = 0; row < 3; ++row) position[axis] -= T[row][column] * T[row][3];
  }
  return position;
}

}  // namespace

void KeyframeStore::add(Keyframe keyframe) {
  const Tensor& image = keyframe.image;
  TORCH_CHECK(keyframe.T_camera_world.sizes() == at::IntArrayRef({4, 4}) &&
                  keyframe.T_camera_world.scalar_type() == torch::kFloat64,
              keyframe.name, ": the pose must be [4,4] float64");
  if (!image.defined()) return append(std::move(keyframe));
  TORCH_CHECK(image.dim() == 3 && image.size(2) == 3 && image.scalar_type() == torch::kUInt8,
              keyframe.name, ": the image must be [H,W,3] uint8, not ", image.toString(),
              image.sizes());
  TORCH_CHECK(
      image.size(0) == keyframe.intrinsics.height && image.size(1) == keyframe.intrinsics.width,
      keyframe.name, ": the image is ", image.sizes(), ", its camera ", keyframe.intrinsics.width,
      " x ", keyframe.intrinsics.height);
  keyframe.saturates =
      (image >= kSaturatedByte).to(torch::kFloat32).mean().item<double>() > kMinSaturatedFraction;
  keyframe.image = image.to(device_);  // may run out of memory; the store is still unchanged
  if (keyframe.scene.defined()) {
    TORCH_CHECK(keyframe.scene.sizes() == image.sizes().slice(0, 2) &&
                    keyframe.scene.scalar_type() == torch::kBool,
                keyframe.name, ": the mask must be [H,W] bool, not ", keyframe.scene.toString(),
                keyframe.scene.sizes());
    keyframe.scene = keyframe.scene.to(device_);
    if (scene_.defined()) keyframe.scene = keyframe.scene & scene_.to(device_);
  }
  image_bytes_ += keyframe.image.nbytes();
  append(std::move(keyframe));
  list_view(keyframes_.size() - 1);
}

void KeyframeStore::list_view(std::size_t i) {
  (keyframes_[i].held_out ? held_out_ : training_).push_back(i);
}

void KeyframeStore::append(Keyframe keyframe) {
  by_stamp_[keyframe.stamp_ns] = keyframes_.size();
  keyframes_.push_back(std::move(keyframe));
}

void KeyframeStore::set_pose(std::size_t i, const Tensor& T_camera_world) {
  TORCH_CHECK(is_rigid(T_camera_world), keyframes_.at(i).name,
              ": the pose is not a rigid transform");
  keyframes_.at(i).T_camera_world = T_camera_world;
}

void KeyframeStore::drop_image(std::size_t i) {
  Keyframe& keyframe = keyframes_.at(i);
  if (!has_image(i)) return;
  if (!is_on_disk(i)) {
    (on_host_.erase(i) > 0 ? host_image_bytes_ : image_bytes_) -= keyframe.image.nbytes();
  }
  files_.erase(i);
  keyframe.image = Tensor();
  keyframe.scene = Tensor();
  std::vector<std::size_t>& views = keyframe.held_out ? held_out_ : training_;
  views.erase(std::remove(views.begin(), views.end(), i), views.end());
}

std::size_t KeyframeStore::move(std::size_t i, const torch::Device& device) {
  Keyframe& keyframe = keyframes_.at(i);
  keyframe.image = keyframe.image.to(device);
  if (keyframe.scene.defined()) keyframe.scene = keyframe.scene.to(device);
  return keyframe.image.nbytes();
}

std::vector<std::size_t> KeyframeStore::keep_off_device(const std::set<std::size_t>& views) {
  std::vector<std::size_t> lost;
  std::set<std::size_t> returning;
  for (const std::size_t i : on_host_) {
    if (views.count(i) == 0) returning.insert(i);
  }
  for (const auto& [i, file] : files_) {
    if (is_on_disk(i) && views.count(i) == 0) returning.insert(i);
  }
  for (const std::size_t i : returning) {
    if (is_on_disk(i) && !read_image(i)) {
      if (!keyframes_[i].held_out) lost.push_back(i);
      drop_image(i);
      continue;
    }
    const std::size_t bytes = move(i, device_);
    on_host_.erase(i);
    host_image_bytes_ -= bytes;
    image_bytes_ += bytes;
  }
  for (const std::size_t i : views) {
    if (on_host_.count(i) != 0 || !keyframes_.at(i).image.defined()) continue;
    const std::size_t bytes = move(i, torch::kCPU);
    on_host_.insert(i);
    image_bytes_ -= bytes;
    host_image_bytes_ += bytes;
  }
  return lost;
}

void KeyframeStore::write_host_images(double max_bytes) {
  if (!folder_) return;
  while (static_cast<double>(host_image_bytes_) > max_bytes && !on_host_.empty()) {
    const std::size_t i = *on_host_.begin();
    Tensor& image = keyframes_[i].image;
    std::shared_ptr<StorageFile>& file = files_[i];
    if (!file) {
      torch::serialize::OutputArchive archive;
      archive.write("image", image);
      file = folder_->write(archive, static_cast<std::int64_t>(image.nbytes()));
    }
    if (!file) {
      files_.erase(i);
      return;
    }
    host_image_bytes_ -= image.nbytes();
    image = Tensor();
    on_host_.erase(i);
  }
}

std::size_t KeyframeStore::images_on_disk() const {
  return static_cast<std::size_t>(std::count_if(
      files_.begin(), files_.end(), [this](const auto& entry) { return is_on_disk(entry.first); }));
}

// Undefined when the file is lost.
Tensor KeyframeStore::image_on_disk(std::size_t i) const {
  Tensor image;
  const gaussians::Intrinsics& camera = keyframes_[i].intrinsics;
  const bool is_read = files_.at(i)->read([&](torch::serialize::InputArchive& archive) {
    archive.read("image", image);
    TORCH_CHECK(image.sizes() == at::IntArrayRef({camera.height, camera.width, 3}),
                "the image has another size");
  });
  return is_read ? image : Tensor();
}

// From its file to host memory.
bool KeyframeStore::read_image(std::size_t i) {
  const Tensor image = image_on_disk(i);
  if (!image.defined()) return false;
  keyframes_[i].image = image;
  on_host_.insert(i);
  host_image_bytes_ += image.nbytes();
  return true;
}

Tensor KeyframeStore::pixels(std::size_t i) const {
  if (!is_on_disk(i)) return keyframes_.at(i).image;
  const Tensor image = image_on_disk(i);
  if (!image.defined()) fail_run("{}: the image is lost", keyframes_[i].name);
  return image;
}

void KeyframeStore::move_images(const torch::Device& device) {
  device_ = device;
  for (Keyframe& keyframe : keyframes_) {
    if (keyframe.image.defined()) keyframe.image = keyframe.image.to(device);
    if (keyframe.scene.defined()) keyframe.scene = keyframe.scene.to(device);
  }
}

void KeyframeStore::set_mask(const Tensor& scene) {
  TORCH_CHECK(scene.dim() == 2 && scene.scalar_type() == torch::kBool,
              "keyframes: a mask is [H,W] bool, not ", scene.sizes());
  scene_ = scene.to(gaussians::active_device());
}

Tensor KeyframeStore::scene(std::size_t i, int factor, const torch::Device& device) const {
  const Tensor& own = keyframes_.at(i).scene;
  const Tensor& full = own.defined() ? own : scene_;
  if (!full.defined() || factor == 1) return full.defined() ? full.to(device) : Tensor();
  const std::int64_t height = full.size(0) / factor;
  const std::int64_t width = full.size(1) / factor;
  return full.slice(0, 0, height * factor)
      .slice(1, 0, width * factor)
      .reshape({height, factor, width, factor})
      .all(3)
      .all(1)
      .to(device);
}

Tensor KeyframeStore::image(std::size_t i, int factor, const torch::Device& device) const {
  return to_float_image(pixels(i).to(device), factor, tone_curve_.byte_table(device));
}

Tensor KeyframeStore::image_values(std::size_t i, int factor, const torch::Device& device) const {
  return to_float_image(pixels(i).to(device), factor);
}

gaussians::View KeyframeStore::view(std::size_t i, int factor) const {
  const Keyframe& keyframe = keyframes_.at(i);
  return {.intrinsics = reduced(keyframe.intrinsics, factor),
          .T_camera_world = keyframe.T_camera_world,
          .pose_delta = {}};
}

Tensor to_float_image(const Tensor& bytes, int factor, const Tensor& table) {
  Tensor image =
      table.defined()
          ? table.index_select(0, bytes.reshape({-1}).to(torch::kInt64)).view(bytes.sizes())
          : bytes.to(torch::kFloat32) / 255.0;
  if (factor == 1) return image;
  const Tensor planes = image.permute({2, 0, 1}).unsqueeze(0);
  return torch::avg_pool2d(planes, factor).squeeze(0).permute({1, 2, 0}).contiguous();
}

bool is_rigid(const Tensor& T) {
  if (!T.defined() || T.sizes() != at::IntArrayRef({4, 4}) || T.scalar_type() != torch::kFloat64) {
    return false;
  }
  if (!torch::isfinite(T).all().item<bool>()) return false;
  const Tensor R = T.slice(0, 0, 3).slice(1, 0, 3);
  const Tensor last = torch::tensor({0.0, 0.0, 0.0, 1.0}, torch::kFloat64);
  return torch::allclose(R.mm(R.t()), torch::eye(3, torch::kFloat64), 0.0, 1e-6) &&
         torch::det(R).item<double>() > 0.0 && torch::allclose(T.select(0, 3), last, 0.0, 1e-9);
}

Tensor rigid_inverse(const Tensor& T) {
  const Tensor Rt = T.slice(0, 0, 3).slice(1, 0, 3).t();
  Tensor inverse = torch::eye(4, T.options());
  inverse.slice(0, 0, 3).slice(1, 0, 3).copy_(Rt);
  inverse.slice(0, 0, 3).select(1, 3).copy_(-Rt.mv(T.slice(0, 0, 3).select(1, 3)));
  return inverse;
}

double motion_size(const Tensor& motion) {
  const Tensor t = motion.slice(0, 0, 3).select(1, 3);
  const Tensor R = motion.slice(0, 0, 3).slice(1, 0, 3) - torch::eye(3, torch::kFloat64);
  return std::max(t.norm().item<double>(), R.norm().item<double>());
}

Tensor camera_center(const Tensor& T_camera_world) {
  const Tensor R = T_camera_world.slice(0, 0, 3).slice(1, 0, 3);
  return -R.t().mv(T_camera_world.slice(0, 0, 3).select(1, 3));
}

double camera_distance(const Tensor& a, const Tensor& b) {
  const auto p = position_of(a);
  const auto q = position_of(b);
  return std::hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]);
}

double scene_extent(const KeyframeStore& store) {
  return scene_extent(std::vector{&store});
}

double scene_extent(const std::vector<const KeyframeStore*>& stores) {
  std::vector<Tensor> centers;
  for (const KeyframeStore* store : stores) {
    for (const std::size_t i : store->training()) {
      centers.push_back(camera_center((*store)[i].T_camera_world));
    }
  }
  if (centers.empty()) return kMinExtent_m;
  const Tensor all = torch::stack(centers);
  const double radius = (all - all.mean(0)).norm(2, 1).max().item<double>();
  return std::max(kMinExtent_m, 1.1 * radius);
}

}  // namespace apvi::mapping
