// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/appearance/view_corrections.hpp"

#include <torch/torch.h>

#include <array>
#include <cmath>
#include <string>

#include "apvi/core/constants.hpp"
#include "gaussians/optimizer/adam.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

// Loss of a deviation by one sigma; comparable to the image loss of a tenth of a pixel.
constexpr double kPriorLoss = 1e-3;

Tensor row(const Tensor& tensor, std::size_t i) {
  return tensor.select(0, static_cast<std::int64_t>(i));
}

std::array<std::pair<const char*, Tensor*>, 4> named(Tensor& value, Tensor& first, Tensor& second,
                                                     Tensor& steps) {
  return {{{"value", &value}, {"first", &first}, {"second", &second}, {"steps", &steps}}};
}

}  // namespace

ViewCorrections::OptimizedParameter ViewCorrections::make(std::size_t views,
                                                          at::IntArrayRef shape) {
  std::vector<std::int64_t> size = {static_cast<std::int64_t>(views)};
  size.insert(size.end(), shape.begin(), shape.end());
  const auto zeros = [&size] { return torch::zeros(size, torch::kFloat64); };
  return {.value = zeros(),
          .first = zeros(),
          .second = zeros(),
          .steps = torch::zeros({size[0]}, torch::kInt64)};
}

ViewCorrections::ViewCorrections(std::size_t views, const PoseOptions& poses,
                                 const ExposureOptions& exposure)
    : pose_options_(poses),
      exposure_options_(exposure),
      poses_(make(views, {6})),
      exposures_(make(views, {2, 3})) {}

void ViewCorrections::add_view() {
  for (OptimizedParameter* param : {&poses_, &exposures_}) {
    for (Tensor* t : {&param->value, &param->first, &param->second, &param->steps}) {
      std::vector<std::int64_t> shape = t->sizes().vec();
      shape[0] = 1;
      *t = torch::cat({*t, torch::zeros(shape, t->options())});
    }
  }
}

Tensor ViewCorrections::pose_delta(std::size_t i, bool learn) const {
  if (!pose_options_.enabled) return {};
  return row(poses_.value, i).clone().requires_grad_(learn);
}

Tensor ViewCorrections::expose(std::size_t i, const Tensor& image, bool learn) {
  exposure_leaf_ = Tensor();
  if (!exposure_options_.enabled) return image;
  exposure_leaf_ = row(exposures_.value, i).clone().requires_grad_(learn);
  const Tensor values = exposure_leaf_.to(image.options());
  return image * values[0].exp() + values[1];
}

void ViewCorrections::step(std::size_t i, const Tensor& pose_delta) {
  if (pose_delta.defined() && pose_delta.grad().defined()) {
    const double m = pose_options_.prior_sigma_m;
    const double rad = kRadiansPerDegree * pose_options_.prior_sigma_deg;
    const Tensor sigma = torch::tensor({m, m, m, rad, rad, rad}, torch::kFloat64);
    adam(poses_, i, pose_delta.grad() + kPriorLoss * row(poses_.value, i) / sigma.square(),
         pose_options_.learning_rate);
  }
  if (exposure_leaf_.defined() && exposure_leaf_.grad().defined()) {
    const double sigma = exposure_options_.prior_sigma;
    adam(exposures_, i,
         exposure_leaf_.grad() + kPriorLoss * row(exposures_.value, i) / (sigma * sigma),
         exposure_options_.learning_rate);
  }
}

void ViewCorrections::adam(OptimizedParameter& param, std::size_t i, const Tensor& gradient,
                           double rate) {
  const torch::NoGradGuard no_grad;
  const Tensor steps = row(param.steps, i).add_(1);
  gaussians::adam_step({{.parameter = row(param.value, i),
                         .gradient = gradient.contiguous(),
                         .first = row(param.first, i),
                         .second = row(param.second, i),
                         .rate = rate}},
                       steps.item<std::int64_t>());
}

void ViewCorrections::change_scale(double scale) {
  const torch::NoGradGuard no_grad;
  if (poses_.value.numel() == 0) return;
  poses_.value.slice(1, 0, 3).mul_(scale);
  poses_.first.zero_();
  poses_.second.zero_();
  poses_.steps.zero_();
}

void ViewCorrections::save(torch::serialize::OutputArchive& archive) const {
  const auto write = [&archive](const std::string& prefix, OptimizedParameter param) {
    for (const auto& [name, tensor] : named(param.value, param.first, param.second, param.steps)) {
      archive.write(prefix + name, *tensor, /*is_buffer=*/true);
    }
  };
  write("pose_", poses_);
  write("exposure_", exposures_);
}

void ViewCorrections::load(torch::serialize::InputArchive& archive) {
  const auto read = [&archive](const std::string& prefix, OptimizedParameter& param) {
    for (const auto& [name, tensor] : named(param.value, param.first, param.second, param.steps)) {
      Tensor loaded;
      archive.read(prefix + name, loaded, /*is_buffer=*/true);
      TORCH_CHECK(loaded.sizes() == tensor->sizes(), "checkpoint: corrections of ", loaded.size(0),
                  " keyframes instead of ", tensor->size(0));
      *tensor = loaded;
    }
  };
  read("pose_", poses_);
  read("exposure_", exposures_);
}

Tensor corrected_pose(const Tensor& T_camera_world, const Tensor& pose_delta) {
  if (!pose_delta.defined()) return T_camera_world;
  const Tensor delta = pose_delta.detach().to(torch::kCPU, torch::kFloat64).contiguous();
  const double* d = delta.data_ptr<double>();
  Tensor twist = torch::zeros({4, 4}, torch::kFloat64);
  auto m = twist.accessor<double, 2>();
  m[0][1] = -d[5];
  m[0][2] = d[4];
  m[1][0] = d[5];
  m[1][2] = -d[3];
  m[2][0] = -d[4];
  m[2][1] = d[3];
  for (int axis = 0; axis < 3; ++axis) m[axis][3] = d[axis];
  return torch::matrix_exp(twist).mm(T_camera_world);
}

}  // namespace apvi::mapping
