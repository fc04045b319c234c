// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/cost_function.h>
#include <ceres/loss_function.h>

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <vector>

namespace apvi::vio {

/// One block of a linearised problem. The tangent of seven numbers is a pose's (six), of any other
/// count the numbers themselves.
struct Block {
  double* data = nullptr;
  int size = 0;
  int tangent() const { return size == 7 ? 6 : size; }
};

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
  /// The block lives elsewhere from now on (the window moved). Does nothing for unknown blocks.
  void relocate(const double* from, double* to);
};

/// The prior as a term of the next problem. Its Jacobian by ⊟ is taken at x0: constant.
class PriorFactor final : public ceres::CostFunction {
 public:
  explicit PriorFactor(std::shared_ptr<const Prior> prior);
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;
  std::vector<double*> blocks() const;

 private:
  std::shared_ptr<const Prior> prior_;
};

/// Terms, linearised where they are, as dense normal equations or a square root; landmarks (blocks
/// of one number in `eliminated_first`) are integrated out one by one as they come.
class Linearizer {
 public:
  enum class Method { schur, square_root };

  /// A term; `loss` may be null. Blocks that are constant are named in `constant`.
  void add(const ceres::CostFunction& cost, const ceres::LossFunction* loss,
           const std::vector<Block>& blocks);
  void hold_constant(const double* block);

  /// Integrates out the blocks in `drop` (poses, motions, landmarks). Directions without
  /// information stay without. Nothing is left when no term touches a kept block.
  Prior marginalize(const std::vector<double*>& drop, Method method) const;

  /// Information of one pose with everything else integrated out: the 6x6 Schur complement, tangent
  /// order [rotation, position].
  Eigen::Matrix<double, 6, 6> marginal_information(const double* pose) const;

 private:
  struct Term {
    std::vector<Block> blocks;
    std::vector<Eigen::MatrixXd> jacobians;  // by tangent
    Eigen::VectorXd residual;
  };
  std::vector<Term> terms_;
  std::vector<const double*> constant_;
};

}  // namespace apvi::vio
