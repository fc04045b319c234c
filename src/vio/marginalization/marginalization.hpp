// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/cost_function.h>
#include <ceres/loss_function.h>

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "vio/window/linear_terms.hpp"

namespace apvi::vio {

/// Marginalization prior ‖r + J (x ⊟ x0)‖², with x0 the values at marginalization. J is upper
/// triangular or rectangular, never squared (Demmel et al., "Square root bundle adjustment", 2021).
class Prior {
 public:
  struct Kept {
    Block block;                ///< address of the state
    std::vector<double> value;  ///< x0
  };
  std::vector<Kept> kept;
  Eigen::MatrixXd J;
  Eigen::VectorXd r;

  /// Updates the address of a block; ignores unknown blocks. To shift a whole window in place, go
  /// from the oldest block on, so that no two blocks share an address.
  void relocate(const double* from, double* to);
};

/// The prior as a cost function. Its Jacobian is constant, as evaluated at x0: d(x ⊟ x0)/dx = 1, in
/// line with first-estimate Jacobians (exact at x0; otherwise it neglects the right Jacobian of the
/// rotation since).
class PriorFactor final : public ceres::CostFunction {
 public:
  explicit PriorFactor(std::shared_ptr<const Prior> prior);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;
  std::vector<double*> blocks() const;

 private:
  std::shared_ptr<const Prior> prior_;
};

/// Linearized terms, and the marginalization of blocks. Block values must not change from the first
/// term to the last call. All added terms count: for a prior, add exactly those terms that leave
/// the problem with the dropped blocks.
class Linearizer {
 public:
  /// Elimination method. `schur`: normal equations, fastest. `square_root`: QR of the Jacobians,
  /// without squaring the condition number, about ten times slower.
  enum class Method { schur, square_root };

  /// Adds a term; `loss` may be null. Returns false and adds nothing if the evaluation fails or is
  /// not finite.
  bool add(const ceres::CostFunction& cost, const ceres::LossFunction* loss,
           const std::vector<Block>& blocks) {
    return terms_.add(cost, loss, blocks);
  }
  /// Holds a block constant. Cheapest if called before the terms are added.
  void hold_constant(const double* block) { terms_.hold_constant(block); }
  /// Removes all terms but keeps the memory.
  void clear() { terms_.clear(); }

  /// Marginalizes the blocks in `drop` (poses, motions, landmarks). Scalar blocks that share no
  /// term with one another are eliminated first, one by one. Directions without information remain
  /// without. The prior is empty if no term touches a kept block.
  Prior marginalize(const std::vector<double*>& drop, Method method) const;

  /// Marginal information of one pose: the 6x6 Schur complement, tangent order [rotation,
  /// position]. Zero if no term touches the pose.
  Eigen::Matrix<double, 6, 6> marginal_information(const double* pose) const;

 private:
  LinearTerms terms_;
};

}  // namespace apvi::vio
