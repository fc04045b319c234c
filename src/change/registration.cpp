// SPDX-License-Identifier: BSD-3-Clause
#include "change/registration.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>

namespace apvi::change {
namespace {

using torch::Tensor;

constexpr std::array kRanges_m = {0.3, 0.2, 0.15, 0.1, 0.07};  // of Tukey's weights, rigid
constexpr int kBends = 3;
constexpr double kSpacing_m = 2.0;
constexpr double kStep_m = 0.01;        // between neighboring nodes
constexpr double kPriorShift_m = 0.1;   // of the rigid motion
constexpr double kPriorTurn = 0.035;    // [rad]
constexpr double kCorrelation_m = 0.1;  // within which the errors of a surface are common
constexpr double kTukey = 4.685;        // standard deviations
constexpr double kSameNormal = 0.5;     // cosine of the angle between normals
constexpr double kMad = 1.4826;

Tensor tukey(const Tensor& normalized) {
  return (1.0 - normalized.square()).clamp_min(0.0).square();
}

double deviation(const Tensor& values) {
  return values.numel() == 0 ? 0.0 : kMad * values.abs().median().item<double>();
}

Tensor squares(const Tensor& v, const Tensor& weight) {
  return weight.view({-1, 1, 1}) * v.unsqueeze(2) * v.unsqueeze(1);
}

Tensor cross_matrices(const Tensor& p) {
  const auto c = p.unbind(1);
  const Tensor zero = torch::zeros_like(c[0]);
  return torch::stack({zero, -c[2], c[1], c[2], zero, -c[0], -c[1], c[0], zero}, 1)
      .view({-1, 3, 3});
}

/// Rotation matrix [3,3] of a rotation vector [3].
Tensor rotation(const Tensor& vector) {
  return torch::matrix_exp(cross_matrices(vector.unsqueeze(0))[0]);
}

/// Values and derivatives of one detail image at pixels, per pixel.
struct Slopes {
  Tensor value, by_u, by_v;
};

Slopes slopes_at(const Tensor& image, const Tensor& pixels, int width) {
  const std::int64_t last = image.size(0) - 1;
  const auto at = [&](std::int64_t step) {
    return image.index_select(0, (pixels + step).clamp(0, last));
  };
  return {at(0), 0.5 * (at(1) - at(-1)), 0.5 * (at(width) - at(-width))};
}

/// Collects the equations of all views for the displacement of each cell.
class Equations {
 public:
  /// `level` of the details, 0 coarse and 1 fine; `scales` of those of the earlier and of the later
  /// session.
  Equations(const SurfaceCells& cells, Tensor points, double range_m, std::int64_t level,
            std::array<double, 2> scales)
      : cells_(cells),
        points_(std::move(points)),
        range_m_(range_m),
        level_(level),
        scales_(scales) {
    const std::int64_t n = points_.size(0);
    H_ = torch::zeros({n, 3, 3}, points_.options());
    g_ = torch::zeros({n, 3}, points_.options());
    count_ = torch::zeros({n}, points_.options());
  }

  void add(const SurfaceView& view) {
    const Observation s = observation(view, points_);
    if (s.rows.numel() == 0) return;
    const Tensor R = camera_pose(view.view, points_).R;
    const Tensor n = s.normals.mm(R);
    const Tensor facing = -(n * cells_.normals.index_select(0, s.rows)).sum(1);
    const Tensor weight = tukey(s.distance / range_m_) * (facing > kSameNormal);
    const double noise = range_m_ / kTukey;
    const Tensor variance = cells_.sigma.index_select(0, s.rows).square() +
                            view.sigma.index_select(0, s.pixels).square();
    const Tensor information = weight / variance.clamp_min(noise * noise);
    H_.index_add_(0, s.rows, squares(n, information));
    g_.index_add_(0, s.rows, (information * s.distance).unsqueeze(1) * n);
    count_.index_add_(0, s.rows, torch::ones_like(weight));
    add_details(view, s, R, weight);
  }

  /// Each cell counts as one measurement of an area of correlated errors.
  PointEquations equations() const {
    const double share =
        std::min(1.0, cells_.cell_m * cells_.cell_m / (kCorrelation_m * kCorrelation_m));
    const Tensor factor = share / count_.clamp_min(1.0);
    return {H_ * factor.view({-1, 1, 1}), g_ * factor.unsqueeze(1)};
  }

 private:
  void add_details(const SurfaceView& view, const Observation& s, const Tensor& R,
                   const Tensor& weight) {
    const gaussians::Intrinsics& k = view.view.intrinsics;
    const Slopes d = slopes_at(view.detail.select(1, level_) / scales_[0], s.pixels, k.width);
    const Tensor z = s.points.select(1, 2);
    const Tensor x = s.points.select(1, 0) / z;
    const Tensor y = s.points.select(1, 1) / z;
    const Tensor column = (s.pixels % k.width).to(torch::kFloat32) + 0.5;
    const Tensor row = s.pixels.div(k.width, "floor").to(torch::kFloat32) + 0.5;
    const Tensor shown =
        d.value + d.by_u * (k.fx * x + k.cx - column) + d.by_v * (k.fy * y + k.cy - row);
    const Tensor own = cells_.detail.select(1, level_).index_select(0, s.rows) / scales_[1];
    const Tensor error = shown - own;
    const double noise = std::max(0.1, deviation(error));
    const Tensor gu = k.fx * d.by_u / z;
    const Tensor gv = k.fy * d.by_v / z;
    const Tensor j = torch::stack({gu, gv, -(gu * x + gv * y)}, 1).mm(R);
    const Tensor information = weight * tukey(error / (kTukey * noise)) / (noise * noise);
    H_.index_add_(0, s.rows, squares(j, information));
    g_.index_add_(0, s.rows, (-information * error).unsqueeze(1) * j);
  }

  const SurfaceCells& cells_;
  Tensor points_;
  double range_m_;
  std::int64_t level_;
  std::array<double, 2> scales_;
  Tensor H_, g_, count_;
};

PointEquations equations_of(const SurfaceCells& cells, const std::vector<SurfaceView>& views,
                            const Tensor& points, double range_m, std::int64_t level,
                            const Tensor& before_detail) {
  const std::array<double, 2> scales = {std::max(1e-3, deviation(before_detail.select(1, level))),
                                        std::max(1e-3, deviation(cells.detail.select(1, level)))};
  Equations all(cells, points, range_m, level, scales);
  for (const SurfaceView& view : views) all.add(view);
  return all.equations();
}

/// Applies the rigid motion that solves the equations.
void move(Registration& r, const Tensor& points, const PointEquations& e) {
  const Tensor p = points.to(torch::kFloat64);
  const Tensor center = p.mean(0);
  const Tensor eye = torch::eye(3, p.options()).expand({p.size(0), 3, 3});
  const Tensor J = torch::cat({eye, -cross_matrices(p - center)}, 2);
  const Tensor JtH = J.transpose(1, 2).matmul(e.H.to(torch::kFloat64));
  Tensor A = JtH.matmul(J).sum(0).cpu();
  const Tensor b = J.transpose(1, 2).matmul(e.g.to(torch::kFloat64).unsqueeze(2)).sum(0).cpu();
  const double shift = 1.0 / (kPriorShift_m * kPriorShift_m);
  const double turn = 1.0 / (kPriorTurn * kPriorTurn);
  A += torch::diag(torch::tensor({shift, shift, shift, turn, turn, turn}, torch::kFloat64));
  const Tensor x = torch::linalg_solve(A, b.squeeze(1), true);
  const Tensor dR = rotation(x.slice(0, 3, 6));
  const Tensor c = center.cpu();
  r.R = dR.mm(r.R);
  r.t = dR.mv(r.t - c) + c + x.slice(0, 0, 3);
}

/// Fills the figures about what was found and what is left.
void summarize(Registration& r, const SurfaceCells& cells, const std::vector<SurfaceView>& views) {
  const Tensor points = r.to_before(cells.points);
  std::vector<Tensor> distances;
  Tensor seen = torch::zeros_like(cells.keys);
  for (const SurfaceView& view : views) {
    const Observation s = observation(view, points);
    distances.push_back(s.distance);
    seen.index_fill_(0, s.rows, 1);
  }
  r.residual_m = deviation(torch::cat(distances));
  r.cells = seen.sum().item<std::int64_t>();
  if (r.cells == 0) return;
  const Tensor common = seen.nonzero().squeeze(1);
  r.shift_m = (points - cells.points).index_select(0, common).norm(2, 1).median().item<double>();
  const Tensor deformed = r.deformation(cells.points).index_select(0, common);
  r.deformation_m = (deformed - deformed.mean(0)).norm(2, 1).median().item<double>();
}

}  // namespace

Tensor Registration::to_before(const Tensor& points) const {
  const Tensor moved = points.mm(R.t().to(points.options())) + t.to(points.options());
  return moved + deformation(moved);
}

Tensor Registration::to_after(const Tensor& points) const {
  return (points - deformation(points) - t.to(points.options())).mm(R.to(points.options()));
}

Tensor Registration::motion_at(const Eigen::Vector3d& point) const {
  const Tensor p = torch::tensor({{point.x(), point.y(), point.z()}}, torch::kFloat64);
  const auto device = deformation.empty() ? torch::Device(torch::kCPU) : deformation.device();
  Tensor T = torch::eye(4, torch::kFloat64);
  T.slice(0, 0, 3).slice(1, 0, 3).copy_(R);
  T.slice(0, 0, 3).select(1, 3).copy_(t + deformation(p.to(device, torch::kFloat32))[0].cpu());
  return T;
}

Registration align(const SurfaceCells& after, const std::vector<SurfaceView>& before,
                   const Tensor& before_detail, const Progress& progress) {
  const torch::NoGradGuard no_grad;
  Registration r;
  const double steps = static_cast<double>(kRanges_m.size()) + kBends;
  double done = 0.0;
  const auto equations = [&](double range_m, std::int64_t level) {
    progress(done++ / steps, "aligning");
    return equations_of(after, before, r.to_before(after.points), range_m, level, before_detail);
  };
  for (const double range : kRanges_m) move(r, r.to_before(after.points), equations(range, 0));
  summarize(r, after, before);
  if (r.cells == 0) return r;
  const double range = std::max(kTukey * r.residual_m, 0.01);
  r.deformation = DeformationField(r.to_before(after.points), kSpacing_m);
  for (int i = 0; i < kBends; ++i) {
    const PointEquations e = equations(range, i == 0 ? 0 : 1);
    const Tensor moved =
        after.points.mm(r.R.t().to(after.points.options())) + r.t.to(after.points.options());
    r.deformation.update(moved, e, kStep_m);
  }
  summarize(r, after, before);
  return r;
}

}  // namespace apvi::change
