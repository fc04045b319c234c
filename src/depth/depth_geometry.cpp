// SPDX-License-Identifier: BSD-3-Clause
#include "depth/depth_geometry.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace apvi::depth {
namespace {

using torch::Tensor;

constexpr double kMaxRotationError = 1e-3;  // maximum element of |R R' - 1|

/// A pose as plain arrays: LibTorch takes microseconds per small matrix, and there are hundreds.
struct RigidTransform {
  std::array<std::array<double, 3>, 3> R = {};
  std::array<double, 3> t = {};

  explicit RigidTransform(const Tensor& T) {
    const auto value = T.accessor<double, 2>();
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j < 3; ++j) {
        R[i][j] = value[static_cast<std::int64_t>(i)][static_cast<std::int64_t>(j)];
      }
      t[i] = value[static_cast<std::int64_t>(i)][3];
    }
  }

  bool finite() const {
    return std::all_of(t.begin(), t.end(), [](double x) { return std::isfinite(x); }) &&
           std::all_of(R.begin(), R.end(), [](const auto& row) {
             return std::all_of(row.begin(), row.end(), [](double x) { return std::isfinite(x); });
           });
  }

  /// Maximum element of |R R' - 1|.
  double rotation_error() const {
    double max_error = 0.0;
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j < 3; ++j) {
        const double product = R[i][0] * R[j][0] + R[i][1] * R[j][1] + R[i][2] * R[j][2];
        max_error = std::max(max_error, std::abs(product - (i == j ? 1.0 : 0.0)));
      }
    }
    return max_error;
  }

  /// T_this_other from T_this_world and T_other_world.
  RigidTransform relative_to(const RigidTransform& other) const {
    RigidTransform out = *this;
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j < 3; ++j) {
        out.R[i][j] = R[i][0] * other.R[j][0] + R[i][1] * other.R[j][1] + R[i][2] * other.R[j][2];
      }
      out.t[i] =
          t[i] - out.R[i][0] * other.t[0] - out.R[i][1] * other.t[1] - out.R[i][2] * other.t[2];
    }
    return out;
  }

  /// Camera center in the other frame: -R' t.
  std::array<double, 3> center() const {
    std::array<double, 3> out = {};
    for (std::size_t i = 0; i < 3; ++i)
      out[i] = -(R[0][i] * t[0] + R[1][i] * t[1] + R[2][i] * t[2]);
    return out;
  }
};

/// [K R K_reference^-1 | K t], row-major.
void project(const gaussians::Intrinsics& k, const gaussians::Intrinsics& reference,
             const RigidTransform& T, float* out) {
  std::array<std::array<double, 4>, 3> M = {};  // R K_reference^-1 and t
  for (std::size_t i = 0; i < 3; ++i) {
    const double x = T.R[i][0] / reference.fx;
    const double y = T.R[i][1] / reference.fy;
    M[i] = {x, y, T.R[i][2] - x * reference.cx - y * reference.cy, T.t[i]};
  }
  for (std::size_t j = 0; j < 4; ++j) {
    out[j] = static_cast<float>(k.fx * M[0][j] + k.cx * M[2][j]);
    out[4 + j] = static_cast<float>(k.fy * M[1][j] + k.cy * M[2][j]);
    out[8 + j] = static_cast<float>(M[2][j]);
  }
}

Tensor inverse_calibration(const gaussians::Intrinsics& k) {
  return torch::tensor(
             {1.0 / k.fx, 0.0, -k.cx / k.fx, 0.0, 1.0 / k.fy, -k.cy / k.fy, 0.0, 0.0, 1.0},
             torch::kFloat32)
      .reshape({3, 3});
}

void check_camera(const gaussians::View& camera, std::size_t i) {
  const gaussians::Intrinsics& k = camera.intrinsics;
  TORCH_CHECK(std::isfinite(k.fx) && std::isfinite(k.fy) && k.fx > 0.0 && k.fy > 0.0 &&
                  std::isfinite(k.cx) && std::isfinite(k.cy),
              "depth: view ", i,
              ": focal lengths and principal point must be finite, focal lengths positive");
  const Tensor& T = camera.T_camera_world;
  TORCH_CHECK(T.defined() && T.sizes() == at::IntArrayRef({4, 4}) &&
                  T.scalar_type() == torch::kFloat64 && T.device().is_cpu(),
              "depth: view ", i, ": the pose must be [4,4] float64 on the CPU");
  const RigidTransform pose(T);
  TORCH_CHECK(pose.finite(), "depth: view ", i, ": the pose is not finite; remove this keyframe");
  TORCH_CHECK(pose.rotation_error() < kMaxRotationError, "depth: view ", i,
              ": the pose's rotation is not orthonormal, error ", pose.rotation_error());
}

void check_intensities(const std::vector<DepthView>& views) {
  std::vector<Tensor> ends;
  for (const DepthView& view : views) {
    const auto range = torch::aminmax(view.gray);
    ends.push_back(std::get<0>(range));
    ends.push_back(std::get<1>(range));
  }
  const Tensor all = torch::stack(ends).to(torch::kCPU);  // one transfer for all views
  for (std::size_t i = 0; i < views.size(); ++i) {
    const float* const range = all.data_ptr<float>() + 2 * i;
    TORCH_CHECK(range[0] >= 0.0F && range[1] <= 1.0F, "depth: view ", i,
                ": intensities must lie in [0, 1], not ", range[0], " to ", range[1]);
  }
}

}  // namespace

void check_views(const std::vector<DepthView>& views) {
  TORCH_CHECK(!views.empty(), "depth: no reference image");
  TORCH_CHECK(views.front().gray.defined(), "depth: view 0: the image is missing");
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Tensor& gray = views[i].gray;
    const gaussians::Intrinsics& k = views[i].camera.intrinsics;
    TORCH_CHECK(gray.defined() && gray.dim() == 2 && gray.scalar_type() == torch::kFloat32 &&
                    gray.device() == views.front().gray.device() && gray.is_contiguous(),
                "depth: view ", i,
                ": the image must be [H,W] float32, contiguous, on the device of view 0");
    TORCH_CHECK(gray.size(0) == k.height && gray.size(1) == k.width && gray.numel() > 0,
                "depth: view ", i, ": the image is ", gray.sizes(), ", its camera ", k.width, " x ",
                k.height);
    check_camera(views[i].camera, i);
  }
  check_intensities(views);
}

SweepGeometry sweep_geometry(const std::vector<DepthView>& views) {
  const gaussians::View& reference = views.front().camera;
  const RigidTransform origin(reference.T_camera_world);
  const auto others = static_cast<std::int64_t>(views.size()) - 1;
  SweepGeometry out = {.projections = torch::empty({others, 3, 4}, torch::kFloat32),
                       .rays = inverse_calibration(reference.intrinsics),
                       .centers = torch::empty({others, 3}, torch::kFloat32),
                       .sizes = torch::empty({others, 2}, torch::kFloat32)};
  auto* projection = out.projections.data_ptr<float>();
  auto* center = out.centers.data_ptr<float>();
  auto* size = out.sizes.data_ptr<float>();
  for (std::size_t i = 1; i < views.size(); ++i, projection += 12) {
    const gaussians::Intrinsics& k = views[i].camera.intrinsics;
    const RigidTransform T = RigidTransform(views[i].camera.T_camera_world).relative_to(origin);
    project(k, reference.intrinsics, T, projection);
    for (const double x : T.center()) *center++ = static_cast<float>(x);
    *size++ = static_cast<float>(k.width);
    *size++ = static_cast<float>(k.height);
    out.baseline_m = std::max(out.baseline_m, std::hypot(T.t[0], T.t[1], T.t[2]));
  }
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

}  // namespace apvi::depth
