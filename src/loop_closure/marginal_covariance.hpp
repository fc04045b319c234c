// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace ceres {
class Problem;
}

namespace apvi::loop_closure {

/// Covariance of some parameter blocks at the present values, all others being unknown as well: the
/// part of the inverse of J^T J, with robust losses as weights. In the tangent space of the blocks,
/// one after the other; zero for constant blocks. Nullopt if the problem is not positive definite.
/// Unlike ceres::Covariance it makes no QR decomposition, which takes minutes for many points.
std::optional<Eigen::MatrixXd> marginal_covariance(ceres::Problem& problem,
                                                   const std::vector<double*>& blocks);

}  // namespace apvi::loop_closure
