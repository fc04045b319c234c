// SPDX-License-Identifier: BSD-3-Clause
#include "depth_geometry.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kRigid = 1e-3;  // how far R R' may be from one

Tensor calibration(const splat::Intrinsics& k) {
  return torch::tensor({k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0}, torch::kFloat64)
      .reshape({3, 3});
}

void check_camera(const splat::View& camera, std::size_t i) {
  const splat::Intrinsics& k = camera.intrinsics;
  TORCH_CHECK(std::isfinite(k.fx) && std::isfinite(k.fy) && k.fx > 0.0 && k.fy > 0.0 &&
                  std::isfinite(k.cx) && std::isfinite(k.cy),
              "depth: view ", i, ": the camera's focal lengths and centre must be numbers");
  const Tensor& T = camera.T_camera_world;
  TORCH_CHECK(T.defined() && T.sizes() == at::IntArrayRef({4, 4}) &&
                  T.scalar_type() == torch::kFloat64 && T.device().is_cpu(),
              "depth: view ", i, ": the pose must be [4,4] float64 on the CPU");
  TORCH_CHECK(torch::isfinite(T).all().item<bool>(), "depth: view ", i,
              ": the pose is not finite; leave such keyframes out");
  const Tensor R = T.slice(0, 0, 3).slice(1, 0, 3);
  const double off = (R.mm(R.t()) - torch::eye(3, torch::kFloat64)).abs().max().item<double>();
  TORCH_CHECK(off < kRigid, "depth: view ", i, ": the pose's rotation is none, off by ", off);
}

}  // namespace

void check_views(const std::vector<DepthView>& views) {
  TORCH_CHECK(!views.empty(), "depth: a picture is needed whose depth is asked for");
  TORCH_CHECK(views.front().grey.defined(), "depth: view 0: the picture is missing");
  std::vector<Tensor> ranges;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Tensor& grey = views[i].grey;
    const splat::Intrinsics& k = views[i].camera.intrinsics;
    TORCH_CHECK(grey.defined() && grey.dim() == 2 && grey.scalar_type() == torch::kFloat32 &&
                    grey.device() == views.front().grey.device() && grey.is_contiguous(),
                "depth: view ", i, ": the picture must be [H,W] float32, where the first one is");
    TORCH_CHECK(grey.size(0) == k.height && grey.size(1) == k.width && grey.numel() > 0,
                "depth: view ", i, ": the picture is ", grey.sizes(), ", its camera ", k.width,
                " x ", k.height);
    check_camera(views[i].camera, i);
    const auto range = torch::aminmax(grey);
    ranges.push_back(torch::stack({std::get<0>(range), std::get<1>(range)}));
  }
  const Tensor all = torch::stack(ranges).to(torch::kCPU);  // once: reading one waits for a GPU
  const auto range = all.accessor<float, 2>();
  for (std::int64_t i = 0; i < all.size(0); ++i) {
    TORCH_CHECK(range[i][0] >= 0.0F && range[i][1] <= 1.0F, "depth: view ", i,
                ": intensities must lie in [0, 1], not ", range[i][0], " to ", range[i][1]);
  }
}

SweepGeometry sweep_geometry(const std::vector<DepthView>& views) {
  const Tensor T_world_reference = torch::inverse(views.front().camera.T_camera_world);
  const Tensor K_inverse = torch::inverse(calibration(views.front().camera.intrinsics));
  SweepGeometry out;
  out.rays = K_inverse.to(torch::kFloat32).contiguous();
  std::vector<Tensor> projections;
  std::vector<Tensor> centers;
  std::vector<double> sizes;
  for (std::size_t i = 1; i < views.size(); ++i) {
    const Tensor T = views[i].camera.T_camera_world.mm(T_world_reference);
    const Tensor R = T.slice(0, 0, 3).slice(1, 0, 3);
    const Tensor t = T.slice(0, 0, 3).slice(1, 3, 4);
    const Tensor K = calibration(views[i].camera.intrinsics);
    projections.push_back(torch::cat({K.mm(R).mm(K_inverse), K.mm(t)}, 1));
    centers.push_back(-R.t().mm(t).squeeze(1));
    sizes.push_back(views[i].camera.intrinsics.width);
    sizes.push_back(views[i].camera.intrinsics.height);
    out.baseline_m = std::max(out.baseline_m, t.norm().item<double>());
  }
  if (projections.empty()) return out;
  out.projections = torch::stack(projections).to(torch::kFloat32).contiguous();
  out.centers = torch::stack(centers).to(torch::kFloat32).contiguous();
  out.sizes = torch::tensor(sizes, torch::kFloat32).reshape({-1, 2});
  return out;
}

SweepGeometry on_device(const SweepGeometry& geometry, const torch::Device& device) {
  return {.projections = geometry.projections.to(device),
          .rays = geometry.rays.to(device),
          .centers = geometry.centers.to(device),
          .sizes = geometry.sizes.to(device),
          .baseline_m = geometry.baseline_m};
}

Tensor hypotheses(double near_m, double far_m, const DepthOptions& options) {
  if (options.spacing == DepthSpacing::linear_depth) {
    return torch::linspace(near_m, far_m, options.hypotheses, torch::kFloat64)
        .reciprocal()
        .to(torch::kFloat32)
        .unsqueeze(0);
  }
  return torch::linspace(1.0 / near_m, 1.0 / far_m, options.hypotheses, torch::kFloat32)
      .unsqueeze(0);
}

Tensor pixels_per_inverse_depth(const SweepGeometry& geometry, const Tensor& points,
                                const Tensor& w) {
  const Tensor rays = torch::cat({points, torch::ones_like(w).unsqueeze(1), w.unsqueeze(1)}, 1);
  const Tensor& P = geometry.projections;
  const Tensor X = P.reshape({-1, 4}).mm(rays.t()).view({-1, 3, w.size(0)});
  const Tensor z = X.slice(1, 2, 3);
  const Tensor xy = X.slice(1, 0, 2) / z;
  const Tensor t = P.slice(2, 3, 4);
  const Tensor moves = (t.slice(1, 0, 2) - xy * t.slice(1, 2, 3)) / z;
  const Tensor sees =
      (z > 1e-6).squeeze(1) & ((xy > 0) & (xy < geometry.sizes.unsqueeze(2))).all(1);
  const Tensor squares = moves.square().sum(1);
  const Tensor seen = sees.to(torch::kFloat32).sum(0);
  return (torch::where(sees, squares, torch::zeros_like(squares)).sum(0) / seen.clamp_min(1.0))
      .sqrt();
}

}  // namespace apvi::mapping
