// SPDX-License-Identifier: BSD-3-Clause
#include "vio/window/linear_terms.hpp"

#include <algorithm>
#include <cmath>

#include "apvi/core/error.hpp"

namespace apvi::vio {
namespace {

// The correction of a robust term used by Ceres (Triggs et al., "Bundle adjustment: a modern
// synthesis", 2000, section 4.3): residual times `residual`, Jacobian times `jacobian` (1 - `along`
// r rᵀ). The second-order part is omitted where the loss is concave.
struct Correction {
  double residual = 1.0;
  double jacobian = 1.0;
  double along = 0.0;
};

Correction correction(const ceres::LossFunction& loss, double squared_norm) {
  double rho[3];
  loss.Evaluate(squared_norm, rho);
  const double root = std::sqrt(rho[1]);
  if (squared_norm == 0.0 || rho[2] <= 0.0) return {.residual = root, .jacobian = root};
  // The root of alpha²/2 - alpha - squared_norm rho''/rho' = 0 below one.
  const double alpha = 1.0 - std::sqrt(1.0 + 2.0 * squared_norm * rho[2] / rho[1]);
  return {.residual = root / (1.0 - alpha), .jacobian = root, .along = alpha / squared_norm};
}

}  // namespace

int LinearTerms::variable_of(const Block& block) {
  const auto [found, is_new] = index_.try_emplace(block.data, static_cast<int>(variables_.size()));
  if (is_new) {
    const bool constant = std::ranges::find(constants_, block.data) != constants_.end();
    variables_.push_back({block, constant});
  }
  return found->second;
}

void LinearTerms::hold_constant(const double* block) {
  constants_.push_back(block);
  const auto found = index_.find(block);
  if (found != index_.end()) variables_[static_cast<std::size_t>(found->second)].constant = true;
}

void LinearTerms::clear() {
  variables_.clear();
  index_.clear();
  constants_.clear();
  terms_.clear();
  parts_.clear();
  numbers_.clear();
}

bool LinearTerms::add(const ceres::CostFunction& cost, const ceres::LossFunction* loss,
                      std::span<const Block> blocks) {
  APVI_CHECK(cost.parameter_block_sizes().size() == blocks.size());
  Term term{.first_part = parts_.size(), .rows = cost.num_residuals(), .residual = numbers_.size()};
  std::size_t end = numbers_.size() + static_cast<std::size_t>(term.rows);
  for (const Block& block : blocks) {
    const int variable = variable_of(block);
    if (variables_[static_cast<std::size_t>(variable)].constant) continue;
    parts_.push_back({variable, end});
    end += static_cast<std::size_t>(term.rows * block.size);
  }
  term.parts = parts_.size() - term.first_part;
  numbers_.resize(end);
  if (!evaluate(cost, term, blocks)) {
    parts_.resize(term.first_part);
    numbers_.resize(term.residual);
    return false;
  }
  if (loss != nullptr) apply_loss(*loss, term);
  terms_.push_back(term);
  return true;
}

bool LinearTerms::evaluate(const ceres::CostFunction& cost, const Term& term,
                           std::span<const Block> blocks) {
  parameters_.clear();
  jacobians_.clear();
  std::size_t part = term.first_part;
  for (const Block& block : blocks) {
    parameters_.push_back(block.data);
    const bool asked =
        part < parts_.size() &&
        variables_[static_cast<std::size_t>(parts_[part].variable)].block.data == block.data;
    jacobians_.push_back(asked ? numbers_.data() + parts_[part++].jacobian : nullptr);
  }
  if (!cost.Evaluate(parameters_.data(), numbers_.data() + term.residual, jacobians_.data())) {
    return false;
  }
  const auto begin = numbers_.begin() + static_cast<std::ptrdiff_t>(term.residual);
  return std::all_of(begin, numbers_.end(), [](double x) { return std::isfinite(x); });
}

void LinearTerms::apply_loss(const ceres::LossFunction& loss, const Term& term) {
  Eigen::Map<Eigen::VectorXd> r(numbers_.data() + term.residual, term.rows);
  const Correction c = correction(loss, r.squaredNorm());
  if (c.residual == 1.0 && c.jacobian == 1.0) return;
  for (const Part& part : parts(term)) {
    const int size = variables_[static_cast<std::size_t>(part.variable)].block.size;
    Eigen::Map<RowMajor> J(numbers_.data() + part.jacobian, term.rows, size);
    if (c.along != 0.0) J -= c.along * r * (r.transpose() * J).eval();
    J *= c.jacobian;
  }
  r *= c.residual;
}

}  // namespace apvi::vio
