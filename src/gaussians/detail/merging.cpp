// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/detail/merging.hpp"

#include <torch/torch.h>

#include <utility>
#include <vector>

#include "gaussians/model/quaternions.hpp"
#include "gaussians/model/symmetric_eigen.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

constexpr double kMinSigma = 1e-3;  // smallest over largest of a merged Gaussian
constexpr double kMinOpticalDepth = 1e-6;
constexpr double kMaxOpticalDepth = 7.0;  // nothing is seen through it
constexpr double kMinArea_m2 = 1e-30;

/// Sums over the Gaussians of each group.
class GroupSums {
 public:
  GroupSums(Tensor group, std::int64_t count) : group_(std::move(group)), count_(count) {}

  /// [N,...] to [count,...].
  Tensor operator()(const Tensor& values) const {
    std::vector<std::int64_t> shape = values.sizes().vec();
    shape.front() = count_;
    return torch::zeros(shape, values.options()).index_add_(0, group_, values.contiguous());
  }

 private:
  Tensor group_;
  std::int64_t count_;
};

/// [N] of the largest cross-sections, without the factor 2 pi [m²].
Tensor areas(const Tensor& log_scales) {
  const Tensor flat = log_scales.sum(1) - std::get<0>(log_scales.min(1));
  return flat.exp().clamp_min(kMinArea_m2);
}

/// [N,3,3] about the means [m²].
Tensor covariances(const Gaussians& g) {
  const Tensor axes = rotations_of(g.quaternions) * g.log_scales.exp().unsqueeze(1);
  return torch::matmul(axes, axes.transpose(1, 2));
}

/// Scales and rotations of covariances [M,3,3].
void set_shape(Gaussians& out, const Tensor& covariance) {
  const torch::TensorOptions options = out.means.options();
  const auto [variances, vectors] = symmetric_eigen(covariance.to(torch::kFloat64));
  const Tensor sigmas = variances.clamp_min(0.0).sqrt();
  const Tensor least = kMinSigma * sigmas.slice(1, 2, 3);
  out.log_scales = torch::maximum(sigmas, least).clamp_min(1e-12).log().to(options);
  const Tensor is_mirrored = (torch::det(vectors) < 0.0).view({-1, 1, 1});
  out.quaternions = quaternions_of(torch::where(is_mirrored, -vectors, vectors)).to(options);
}

/// The opacity that has an optical depth, as a logit: the inverse of softplus.
Tensor logit_of(const Tensor& optical_depth) {
  const Tensor t = optical_depth.clamp_min(kMinOpticalDepth);
  return t + torch::log(-torch::expm1(-t));
}

}  // namespace

Gaussians merged(const Gaussians& g, const Tensor& group, std::int64_t count) {
  const torch::NoGradGuard no_grad;
  const GroupSums sum(group, count);
  const Tensor area = areas(g.log_scales);
  const Tensor weight = area * g.logit_opacities.sigmoid().clamp_min(kMinOpticalDepth);
  const Tensor part = weight / sum(weight).index_select(0, group);  // of the group, sums to 1
  const auto mean = [&](const Tensor& values) {
    std::vector<std::int64_t> shape(static_cast<std::size_t>(values.dim()), 1);
    shape.front() = -1;
    return sum(values * part.view(shape));
  };
  const Tensor means = mean(g.means.to(torch::kFloat64));
  const Tensor offset =
      (g.means.to(torch::kFloat64) - means.index_select(0, group)).to(g.means.options());
  Gaussians out;
  out.means = means.to(g.means.options());
  set_shape(out, mean(covariances(g) + offset.unsqueeze(2) * offset.unsqueeze(1)));
  const Tensor depth =
      torch::nn::functional::softplus(g.logit_opacities).clamp_max(kMaxOpticalDepth);
  out.logit_opacities = logit_of(sum(depth * area) / areas(out.log_scales));
  out.sh_dc = mean(g.sh_dc);
  out.sh_rest = mean(g.sh_rest);
  return out;
}

}  // namespace apvi::gaussians
