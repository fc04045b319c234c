// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/slam/system.hpp"

#include <torch/torch.h>

#include <mutex>
#include <opencv2/core.hpp>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/localization/system.hpp"
#include "gaussians/device.hpp"
#include "slam/async_mapper.hpp"
#include "slam/mapper_options.hpp"

namespace apvi::slam {
namespace {

using torch::Tensor;

// Exceptions of LibTorch and OpenCV do not leave the library.
template <typename Work>
auto translate_errors(const Work& work) {
  try {
    return work();
  } catch (const c10::Error& error) {
    if (gaussians::is_out_of_memory(error)) {
      fail_run("out of memory on the device: lower mapping.max_gaussians or mapping.image_scale");
    }
    fail_run("LibTorch: {}", error.what_without_backtrace());
  } catch (const cv::Exception& error) {
    fail_run("OpenCV: {}: {}", error.func, error.err);
  }
}

std::vector<float> to_vector(const Tensor& tensor) {
  const Tensor flat = tensor.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  return {flat.data_ptr<float>(), flat.data_ptr<float>() + flat.numel()};
}

std::array<double, 3> to_array(const Tensor& rgb) {
  const Tensor v = rgb.detach().to(torch::kCPU, torch::kFloat64).contiguous();
  const double* const x = v.data_ptr<double>();
  return {x[0], x[1], x[2]};
}

MapSnapshot to_snapshot(const MapCopy& copy) {
  const gaussians::Gaussians& g = copy.map.gaussians;
  const Tensor sh = torch::cat({g.sh_dc.unsqueeze(1), g.sh_rest}, 1);
  MapSnapshot out = {.iteration = copy.iteration,
                     .count = static_cast<std::size_t>(g.size()),
                     .means = to_vector(g.means),
                     .log_scales = to_vector(g.log_scales),
                     .quaternions = to_vector(g.quaternions),
                     .logit_opacities = to_vector(g.logit_opacities),
                     .sh_coefficients = static_cast<std::size_t>(sh.size(1)),
                     .spherical_harmonics = to_vector(sh),
                     .medium = std::nullopt,
                     .keyframes = copy.keyframes};
  if (const auto& medium = copy.map.medium) {
    out.medium = {.beta_d = to_array(medium->beta_d),
                  .beta_b = to_array(medium->beta_b),
                  .b_inf = to_array(medium->b_inf)};
  }
  return out;
}

gaussians::View to_view(const RenderView& view) {
  const CameraModel::Parameters& camera = view.camera;
  if (camera.width <= 0 || camera.height <= 0 || camera.fx <= 0.0 || camera.fy <= 0.0) {
    fail_input("render: a camera of {} x {} pixels with focal lengths {}, {}", camera.width,
               camera.height, camera.fx, camera.fy);
  }
  return {.intrinsics = to_intrinsics(camera),
          .T_camera_world = to_tensor(view.T_world_camera.inverse()),
          .pose_delta = {}};
}

}  // namespace

struct System::Implementation {
  Implementation(const Options& options, const Rig& rig, SystemCallbacks callbacks)
      : callbacks_(std::move(callbacks)) {
    const bool camera = options.localization.sensors.includes("camera") && !rig.cameras.empty();
    if (options.mapping.enabled == MapSwitch::on && !camera) {
      fail_input("mapping.enabled: true: the rig has no camera");
    }
    if (options.mapping.enabled != MapSwitch::off && camera) {
      mapper_.emplace(async_mapper_options(options, rig), rig, AsyncMapperCallbacks{});
    }
    localization::SystemCallbacks out;
    out.pose = [this](const StampedPose& pose) { take(pose); };
    out.scale_found = [this](const localization::ScaleFound& found) { take(found); };
    out.map = mapper_ ? &*mapper_ : nullptr;
    localization_.emplace(options.localization, rig, std::move(out));
  }

  void take(const localization::ScaleFound& found) {
    const std::scoped_lock lock(mutex_);
    localization::apply(found, trajectory_);
  }

  void take(const StampedPose& pose) {
    {
      const std::scoped_lock lock(mutex_);
      trajectory_.merge({pose});
    }
    if (callbacks_.pose) callbacks_.pose(pose);
  }

  // Why mapping is disabled; called after its thread has ended or failed.
  std::string mapping_error() const {
    if (!mapper_ || !mapper_->failed()) return "";
    try {
      translate_errors([this] { std::rethrow_exception(mapper_->failure()); });
    } catch (const std::exception& error) {
      return error.what();
    }
    return "";
  }

  SystemCallbacks callbacks_;
  mutable std::mutex mutex_;
  Trajectory trajectory_;  // guarded by mutex_
  std::optional<AsyncMapper> mapper_;
  std::optional<localization::System> localization_;  // last: its threads end before the mapper
};

System::System(const Options& options, const Rig& rig, SystemCallbacks callbacks) {
  options.check();
  translate_errors([&] {
    implementation_ = std::make_unique<Implementation>(options, rig, std::move(callbacks));
  });
}

System::~System() = default;

void System::process(const SensorEvent& event) {
  implementation_->localization_->process(event);
}

void System::finish() {
  implementation_->localization_->finish();
  if (implementation_->mapper_) implementation_->mapper_->finish();
}

void System::refine() {
  auto& mapper = implementation_->mapper_;
  if (!mapper || mapper->failed() || mapper->gaussian_count() == 0) return;
  translate_errors([&] { mapper->refine(); });
}

void System::stop() {
  implementation_->localization_->stop();
  if (implementation_->mapper_) implementation_->mapper_->stop();
}

Trajectory System::trajectory() const {
  const std::scoped_lock lock(implementation_->mutex_);
  return implementation_->trajectory_;
}

std::optional<StampedPose> System::pose() const {
  const std::scoped_lock lock(implementation_->mutex_);
  const Trajectory& trajectory = implementation_->trajectory_;
  return trajectory.empty() ? std::nullopt : std::optional(trajectory.poses.back());
}

Status System::status() const {
  Status status;
  {
    const std::scoped_lock lock(implementation_->mutex_);
    status.poses = implementation_->trajectory_.size();
  }
  if (const auto& mapper = implementation_->mapper_) {
    status.keyframes = static_cast<std::size_t>(mapper->keyframe_count());
    status.gaussians = static_cast<std::size_t>(mapper->gaussian_count());
  }
  status.mapping_error = implementation_->mapping_error();
  return status;
}

std::optional<MapSnapshot> System::map() const {
  const auto& mapper = implementation_->mapper_;
  if (!mapper) return std::nullopt;
  return translate_errors([&]() -> std::optional<MapSnapshot> {
    const MapCopy copy = mapper->snapshot();
    if (copy.map.gaussians.size() == 0) return std::nullopt;
    return to_snapshot(copy);
  });
}

std::optional<RenderedImages> System::render(const RenderView& view) const {
  const auto& mapper = implementation_->mapper_;
  if (!mapper) return std::nullopt;
  const gaussians::View camera = to_view(view);
  return translate_errors([&]() -> std::optional<RenderedImages> {
    const mapping::MapRendering images = mapper->render(camera);
    if (!images.color.defined()) return std::nullopt;
    return RenderedImages{.width = view.camera.width,
                          .height = view.camera.height,
                          .color = to_vector(images.color),
                          .restored = to_vector(images.restored),
                          .depth = to_vector(images.depth),
                          .alpha = to_vector(images.alpha)};
  });
}

}  // namespace apvi::slam
