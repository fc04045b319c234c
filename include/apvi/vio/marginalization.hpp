// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/cost_function.h>
#include <ceres/loss_function.h>

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "apvi/vio/linear_terms.hpp"

namespace apvi::vio {

/// What is left of measurements after states were integrated out: ‖r + J (x ⊟ x0)‖², with x0 the
/// values at that time. J is upper triangular or rectangular, never squared (Demmel et al.,
/// "Square root bundle adjustment", 2021).
class Prior {
 public:
  struct Kept {
    Block block;                ///< where the state lives now
    std::vector<double> value;  ///< x0
  };
  std::vector<Kept> kept;
  Eigen::MatrixXd J;
  Eigen::VectorXd r;

  int tangent_size() const;
  /// The block lives elsewhere from now on (the window moved). Does nothing for unknown blocks. To
  /// shift a whole window in place go from the oldest on, so that no two blocks ever share a place.
  void relocate(const double* from, double* to);
};

/// The prior as a term of the next problem. Its Jacobian by ⊟ is taken at x0 and so is constant:
/// d(x ⊟ x0)/dx = 1, as first-estimate Jacobians want it (exact at x0, and off by the right
/// Jacobian of the rotation since).
class PriorFactor final : public ceres::CostFunction {
 public:
  explicit PriorFactor(std::shared_ptr<const Prior> prior);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;
  std::vector<double*> blocks() const;

 private:
  std::shared_ptr<const Prior> prior_;
};

/// Terms, linearised where they are, and what follows from them when some blocks are integrated
/// out. Blocks must keep their values from the first term to the last call. All terms count: for a
/// prior add those that leave the problem with the dropped blocks, and no others.
class Linearizer {
 public:
  /// How blocks are integrated out. `schur`: normal equations, the fastest. `square_root`: QR of
  /// the Jacobians, without squaring the condition number, some ten times slower.
  enum class Method { schur, square_root };

  /// A term; `loss` may be null. False, and nothing added, when the term cannot be evaluated or is
  /// not finite.
  bool add(const ceres::CostFunction& cost, const ceres::LossFunction* loss,
           const std::vector<Block>& blocks) {
    return terms_.add(cost, loss, blocks);
  }
  /// Terms have no derivative by this block. Cheapest when said before they are added.
  void hold_constant(const double* block) { terms_.hold_constant(block); }
  /// Starts anew and keeps the memory.
  void clear() { terms_.clear(); }

  /// Integrates out the blocks in `drop` (poses, motions, landmarks; blocks of one number, each
  /// without another of them in its terms, go first, one by one). Directions without information
  /// stay without. Nothing is left when no term touches a kept block.
  Prior marginalize(const std::vector<double*>& drop, Method method) const;

  /// Information of one pose with everything else integrated out: the 6x6 Schur complement, tangent
  /// order [rotation, position]. Zero when no term touches the pose.
  Eigen::Matrix<double, 6, 6> marginal_information(const double* pose) const;

 private:
  LinearTerms terms_;
};

}  // namespace apvi::vio
