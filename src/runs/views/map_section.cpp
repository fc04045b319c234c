// SPDX-License-Identifier: BSD-3-Clause
#include "runs/views/map_section.hpp"

#include <torch/torch.h>

#include "gaussians/model/rows.hpp"

namespace apvi::runs {
namespace {

bool equal(const viewer::Section& a, const viewer::Section& b) {
  return a.normal == b.normal && a.offset_m == b.offset_m && a.thickness_m == b.thickness_m;
}

}  // namespace

mapping::Map cut(const mapping::Map& map, const viewer::Section& section) {
  const torch::NoGradGuard no_grad;
  const Eigen::Vector3d& n = section.normal;
  const torch::Tensor& means = map.gaussians.means;
  const torch::Tensor normal = torch::tensor({n.x(), n.y(), n.z()}, means.options());
  const torch::Tensor heights = means.matmul(normal) - section.offset_m;
  mapping::Map out = map;
  out.gaussians = gaussians::select(
      map.gaussians, (heights.abs() <= 0.5 * section.thickness_m).nonzero().squeeze(1));
  return out;
}

const mapping::Map& MapSection::of(const mapping::Map& map,
                                   const std::optional<viewer::Section>& section) {
  if (!section) return map;
  if (!section_ || !equal(*section_, *section)) {
    cut_ = cut(map, *section);
    section_ = section;
  }
  return cut_;
}

}  // namespace apvi::runs
