// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/render/render.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>

#include "gaussians/render/raster_backend.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;
using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

constexpr int kMaxSide = 1 << 15;   // [px]
constexpr std::size_t kInputs = 8;  // differentiable inputs

Tensor cross_matrix(const Tensor& v) {
  Tensor out = torch::zeros({3, 3}, v.options());
  const auto x = v.accessor<double, 1>();
  auto m = out.accessor<double, 2>();
  m[0][1] = -x[2];
  m[0][2] = x[1];
  m[1][0] = x[2];
  m[1][2] = -x[0];
  m[2][0] = -x[1];
  m[2][1] = x[0];
  return out;
}

/// Exp(delta) of SE(3) as a matrix [4,4].
Tensor se3_exp(const Tensor& delta) {
  const Tensor generator = torch::zeros({4, 4}, delta.options());
  generator.slice(0, 0, 3).slice(1, 0, 3).copy_(cross_matrix(delta.slice(0, 3)));
  generator.slice(0, 0, 3).select(1, 3).copy_(delta.slice(0, 0, 3));
  return torch::matrix_exp(generator);
}

/// Left Jacobian of SE(3): Exp(delta + d) = Exp(J d) Exp(delta) to first order. It is the integral
/// of Exp(s ad(delta)) over s from 0 to 1, obtained from a matrix exponential of twice the size.
Tensor se3_left_jacobian(const Tensor& delta) {
  const Tensor block = torch::zeros({12, 12}, delta.options());
  const Tensor rotation = cross_matrix(delta.slice(0, 3));
  block.slice(0, 0, 3).slice(1, 0, 3).copy_(rotation);
  block.slice(0, 3, 6).slice(1, 3, 6).copy_(rotation);
  block.slice(0, 0, 3).slice(1, 3, 6).copy_(cross_matrix(delta.slice(0, 0, 3)));
  block.slice(0, 0, 6).slice(1, 6, 12).copy_(torch::eye(6, delta.options()));
  return torch::matrix_exp(block).slice(0, 0, 6).slice(1, 6, 12);
}

Tensor on_host(const Tensor& tensor) {
  return tensor.detach().to(torch::kCPU, torch::kFloat64);
}

/// World to camera, left-multiplied with Exp(delta) (empty: none).
Tensor perturbed(const Tensor& T_camera_world, const Tensor& delta) {
  if (delta.numel() == 0) return T_camera_world.contiguous();
  return se3_exp(on_host(delta)).matmul(on_host(T_camera_world)).contiguous();
}

/// Rasterizer input from the eight differentiable tensors.
RasterInput to_input(const variable_list& tensors, const View& view, const RenderOptions& options) {
  RasterInput input = {.gaussians = {},
                       .light = options.light.defined() ? options.light.contiguous() : Tensor(),
                       .background = tensors[7].contiguous(),
                       .T_camera_world = perturbed(view.T_camera_world, tensors[6]),
                       .intrinsics = view.intrinsics,
                       .sh_degree = 0,
                       .near_m = options.near_m,
                       .low_pass_px2 = options.low_pass_px2,
                       .antialiased = options.antialiased};
  const auto members = input.gaussians.tensors();
  for (std::size_t i = 0; i < members.size(); ++i) *members[i] = tensors[i].contiguous();
  input.sh_degree = std::min(options.sh_degree, input.gaussians.sh_degree());
  return input;
}

/// State of the backward pass that autograd does not save.
struct RenderPass : torch::CustomClassHolder {
  View view;
  RenderOptions options;
  RenderStatistics statistics;
  std::shared_ptr<SparseGradient> sparse_gradient;
};

/// A contiguous gradient; if undefined, zeros like `zeros`, or undefined if that is.
Tensor contiguous_or_zeros(const Tensor& grad, const Tensor& zeros) {
  if (grad.defined()) return grad.contiguous();
  return zeros.defined() ? torch::zeros_like(zeros) : Tensor();
}

/// Gradient with respect to pose_delta, from that of a left perturbation of the pose.
Tensor pose_gradient(const Tensor& delta, const Tensor& grad_perturbation) {
  if (!delta.defined()) return {};
  const Tensor jacobian = se3_left_jacobian(on_host(delta)).to(grad_perturbation.options());
  return jacobian.t().matmul(grad_perturbation).to(delta.options().requires_grad(false));
}

struct Rasterize : torch::autograd::Function<Rasterize> {
  static variable_list forward(AutogradContext* context, const Tensor& means,
                               const Tensor& log_scales, const Tensor& quaternions,
                               const Tensor& logit_opacities, const Tensor& sh_dc,
                               const Tensor& sh_rest, const Tensor& pose_delta,
                               const Tensor& background,
                               const c10::intrusive_ptr<RenderPass>& pass) {
    variable_list saved = {means, log_scales, quaternions, logit_opacities,
                           sh_dc, sh_rest,    pose_delta,  background};
    const RasterInput input = to_input(saved, pass->view, pass->options);
    RasterOutput out = raster_backend(means.device()).forward(input);
    pass->statistics = {.visible = out.visible,
                        .radii_px = out.radii_px,
                        .max_weight = out.max_weight,
                        .mean2d_gradient = torch::zeros({means.size(0)}, means.options())};
    saved.insert(saved.end(), {out.color, out.depth, out.alpha});
    saved.insert(saved.end(), out.state.begin(), out.state.end());
    context->save_for_backward(saved);
    context->set_materialize_grads(false);
    context->saved_data["pass"] = c10::IValue::make_capsule(pass);
    return {out.color, out.depth, out.alpha};
  }

  static variable_list backward(AutogradContext* context, const variable_list& grads) {
    const variable_list saved = context->get_saved_variables();
    const auto pass = context->saved_data["pass"].toCapsule();
    const auto& render = static_cast<const RenderPass&>(*pass);
    const RasterInput input = to_input(saved, render.view, render.options);
    const RasterOutput output = {.color = saved[kInputs],
                                 .depth = saved[kInputs + 1],
                                 .alpha = saved[kInputs + 2],
                                 .visible = render.statistics.visible,
                                 .radii_px = render.statistics.radii_px,
                                 .max_weight = render.statistics.max_weight,
                                 .state = {saved.begin() + kInputs + 3, saved.end()}};
    RasterInputGradient g = raster_backend(input.background.device())
                                .backward(input, output,
                                          {.color = contiguous_or_zeros(grads[0], output.color),
                                           .depth = contiguous_or_zeros(grads[1], {}),
                                           .alpha = contiguous_or_zeros(grads[2], {})},
                                          render.sparse_gradient != nullptr);
    if (render.sparse_gradient != nullptr) *render.sparse_gradient = g.sparse;
    Tensor mean2d_gradient = render.statistics.mean2d_gradient;
    mean2d_gradient.set_(g.mean2d);
    return {g.gaussians.means,
            g.gaussians.log_scales,
            g.gaussians.quaternions,
            g.gaussians.logit_opacities,
            g.gaussians.sh_dc,
            g.gaussians.sh_rest,
            pose_gradient(render.view.pose_delta, g.pose),
            g.background,
            Tensor()};
  }
};

/// Zeros [3] of the type and on the device of a tensor; cached, as launching a kernel for them
/// takes longer than running it.
const Tensor& black(const Tensor& like) {
  static thread_local Tensor saved;
  if (!saved.defined() || saved.device() != like.device() ||
      saved.scalar_type() != like.scalar_type()) {
    saved = torch::zeros({3}, like.options().requires_grad(false));
  }
  return saved;
}

/// Renders only the images, without autograd.
RenderOutput render_images(const Gaussians& g, const Tensor& pose_delta, const Tensor& background,
                           const RenderPass& pass) {
  RasterInput input = to_input({g.means, g.log_scales, g.quaternions, g.logit_opacities, g.sh_dc,
                                g.sh_rest, pose_delta, background},
                               pass.view, pass.options);
  input.images_only = true;
  const RasterOutput out = raster_backend(g.means.device()).forward(input);
  return {.color = out.color,
          .depth = out.depth,
          .alpha = out.alpha,
          .statistics = {},
          .sparse_gradient = nullptr};
}

/// For a small matrix; LibTorch operators would take longer than some renderings.
bool all_finite(const Tensor& matrix) {
  const auto m = matrix.accessor<double, 2>();
  double sum = 0.0;
  for (std::int64_t i = 0; i < m.size(0); ++i) {
    for (std::int64_t j = 0; j < m.size(1); ++j) sum += 0.0 * m[i][j];
  }
  return sum == 0.0;
}

void check_view(const View& view) {
  const Intrinsics& k = view.intrinsics;
  TORCH_CHECK(k.width > 0 && k.height > 0 && k.width <= kMaxSide && k.height <= kMaxSide,
              "render: invalid image size ", k.width, "x", k.height, " px; both must be 1 to ",
              kMaxSide);
  TORCH_CHECK(k.fx > 0 && k.fy > 0 && std::isfinite(k.fx + k.fy + k.cx + k.cy),
              "render: invalid focal lengths ", k.fx, ", ", k.fy, " with center ", k.cx, ", ",
              k.cy);
  const Tensor& T = view.T_camera_world;
  TORCH_CHECK(T.defined() && T.sizes() == at::IntArrayRef({4, 4}) && T.device().is_cpu() &&
                  T.scalar_type() == torch::kFloat64,
              "render: T_camera_world must be [4,4] float64 on the CPU");
  TORCH_CHECK(all_finite(T), "render: T_camera_world is not finite");
  const Tensor& delta = view.pose_delta;
  if (!delta.defined()) return;
  TORCH_CHECK(delta.sizes() == at::IntArrayRef({6}) && delta.is_floating_point(),
              "render: pose_delta must be [6] and floating, not ", delta.sizes());
  TORCH_CHECK(torch::isfinite(delta).all().item<bool>(), "render: pose_delta is not finite");
}

void check_options(const RenderOptions& options, const Gaussians& gaussians) {
  TORCH_CHECK(options.sh_degree >= 0, "render: sh_degree ", options.sh_degree, " is negative");
  TORCH_CHECK(options.near_m > 0 && std::isfinite(options.near_m),
              "render: near_m must be positive, not ", options.near_m);
  TORCH_CHECK(options.low_pass_px2 > 0 && std::isfinite(options.low_pass_px2),
              "render: low_pass_px2 must be positive, not ", options.low_pass_px2);
  const auto fits = [&gaussians](const Tensor& tensor, at::IntArrayRef sizes) {
    return tensor.sizes() == sizes && tensor.scalar_type() == gaussians.means.scalar_type() &&
           tensor.device() == gaussians.means.device();
  };
  TORCH_CHECK(!options.light.defined() || fits(options.light, {gaussians.size(), 3}),
              "render: light must be [N,3] of the type and on the device of the Gaussians");
  TORCH_CHECK(!options.background.defined() || fits(options.background, {3}),
              "render: background must be [3] of the type and on the device of the Gaussians");
}

}  // namespace

RenderOutput render(const Gaussians& gaussians, const View& view, const RenderOptions& options) {
  check(gaussians);
  check_view(view);
  check_options(options, gaussians);
  auto pass = c10::make_intrusive<RenderPass>();
  pass->view = view;
  pass->options = options;
  if (options.sparse_gradient && raster_backend(gaussians.means.device()).has_sparse_gradient()) {
    pass->sparse_gradient = std::make_shared<SparseGradient>();
  }
  const Tensor background =
      options.background.defined() ? options.background : black(gaussians.means);
  // Autograd does not accept undefined tensors.
  const Tensor delta = view.pose_delta.defined() ? view.pose_delta : torch::empty({0});
  if (!torch::GradMode::is_enabled()) return render_images(gaussians, delta, background, *pass);
  const variable_list images = Rasterize::apply(
      gaussians.means, gaussians.log_scales, gaussians.quaternions, gaussians.logit_opacities,
      gaussians.sh_dc, gaussians.sh_rest, delta, background, pass);
  return {.color = images[0],
          .depth = images[1],
          .alpha = images[2],
          .statistics = pass->statistics,
          .sparse_gradient = pass->sparse_gradient};
}

Tensor depth_to_range(const Tensor& depth, const Intrinsics& intrinsics) {
  TORCH_CHECK(depth.sizes() == at::IntArrayRef({intrinsics.height, intrinsics.width}),
              "depth_to_range: the depth has shape ", depth.sizes(), ", the camera ",
              intrinsics.height, "x", intrinsics.width);
  const auto options = depth.options().requires_grad(false);
  const Tensor x = (torch::arange(intrinsics.width, options) + 0.5 - intrinsics.cx) / intrinsics.fx;
  const Tensor y =
      (torch::arange(intrinsics.height, options) + 0.5 - intrinsics.cy) / intrinsics.fy;
  return depth * torch::sqrt(x.square() + y.square().unsqueeze(1) + 1.0);
}

}  // namespace apvi::gaussians
