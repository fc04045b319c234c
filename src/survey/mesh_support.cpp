// SPDX-License-Identifier: BSD-3-Clause
#include "survey/mesh_support.hpp"

#include <torch/torch.h>

#include <algorithm>

#include "survey/mesh_views.hpp"
#include "survey/projection.hpp"

namespace apvi::survey {
namespace {

constexpr std::int64_t kMinViews = 3;

}  // namespace

torch::Tensor supported_points(const torch::Tensor& points, const mapping::Map& map,
                               const std::vector<SurveyView>& views, double tolerance_m,
                               const Progress& progress) {
  const torch::NoGradGuard no_grad;
  const torch::Tensor p = points.to(map.gaussians.means.device(), torch::kFloat32);
  torch::Tensor count = torch::zeros({p.size(0)}, p.options().dtype(torch::kInt32));
  double done = 0.0;
  for (const SurveyView& view : views) {
    progress(done++ / static_cast<double>(views.size()));
    const Projection at = project(view.camera, p);
    if (!at.inside.any().item<bool>()) continue;
    const torch::Tensor seen = reliable_depth(map, view).flatten().index_select(0, at.pixel);
    count += at.inside & (seen > 0.0) & ((seen - at.depth).abs() < tolerance_m);
  }
  const auto enough = std::min(kMinViews, static_cast<std::int64_t>(views.size()));
  return (count >= enough).to(torch::kCPU);
}

}  // namespace apvi::survey
