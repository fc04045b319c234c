// SPDX-License-Identifier: BSD-3-Clause
#include "survey/crs_points.hpp"

#include <torch/torch.h>

namespace apvi::survey {

using torch::Tensor;

Tensor crs_rotation(const SurveyMap& map) {
  const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> R = map.T_crs_map.rotation.toRotationMatrix();
  return torch::from_blob(const_cast<double*>(R.data()), {3, 3}, torch::kFloat64)
      .to(map.map.gaussians.means.device(), torch::kFloat64, false, true);
}

Tensor crs_points(const SurveyMap& map, const Eigen::Vector3d& anchor) {
  const Eigen::Vector3d t = map.T_crs_map.translation - anchor;
  const Tensor means = map.map.gaussians.means.detach().to(torch::kFloat64);
  const Tensor shift = torch::tensor({t.x(), t.y(), t.z()}, means.options());
  return means.mm(crs_rotation(map).t()) + shift;
}

}  // namespace apvi::survey
