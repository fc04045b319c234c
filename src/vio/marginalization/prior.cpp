// SPDX-License-Identifier: BSD-3-Clause
#include <utility>

#include "vio/factors/factors.hpp"
#include "vio/marginalization/marginalization.hpp"

namespace apvi::vio {
namespace {

// x ⊟ x0 of one block.
void difference(const Prior::Kept& kept, const double* x, double* delta) {
  if (kept.block.size == kPoseSize) {
    PoseManifold().Minus(x, kept.value.data(), delta);
    return;
  }
  for (int i = 0; i < kept.block.size; ++i) delta[i] = x[i] - kept.value[static_cast<size_t>(i)];
}

}  // namespace

void Prior::relocate(const double* from, double* to) {
  for (Kept& k : kept) {
    if (k.block.data == from) k.block.data = to;
  }
}

PriorFactor::PriorFactor(std::shared_ptr<const Prior> prior) : prior_(std::move(prior)) {
  for (const Prior::Kept& k : prior_->kept)
    mutable_parameter_block_sizes()->push_back(k.block.size);
  set_num_residuals(static_cast<int>(prior_->r.size()));
}

bool PriorFactor::Evaluate(double const* const* parameters, double* residuals,
                           double** jacobians) const {
  const std::vector<Prior::Kept>& kept = prior_->kept;
  const Eigen::Index rows = prior_->r.size();
  Eigen::VectorXd delta(prior_->J.cols());
  Eigen::Index column = 0;
  for (std::size_t i = 0; i < kept.size(); ++i) {
    const int tangent = kept[i].block.tangent();
    difference(kept[i], parameters[i], delta.data() + column);
    if (jacobians != nullptr && jacobians[i] != nullptr) {
      using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
      Eigen::Map<RowMajor> J(jacobians[i], rows, kept[i].block.size);
      J.leftCols(tangent) = prior_->J.middleCols(column, tangent);
      J.rightCols(kept[i].block.size - tangent).setZero();
    }
    column += tangent;
  }
  Eigen::Map<Eigen::VectorXd> r(residuals, rows);
  r = prior_->r;
  r.noalias() += prior_->J * delta;
  return true;
}

std::vector<double*> PriorFactor::blocks() const {
  std::vector<double*> result;
  for (const Prior::Kept& k : prior_->kept) result.push_back(k.block.data);
  return result;
}

}  // namespace apvi::vio
