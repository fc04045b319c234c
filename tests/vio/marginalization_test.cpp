// SPDX-License-Identifier: BSD-3-Clause
#include "vio/marginalization/marginalization.hpp"

#include <ceres/crs_matrix.h>
#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <limits>
#include <memory>

#include "vio/factor_check.hpp"
#include "vio/linear_problem.hpp"

namespace apvi::vio {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using test::LinearProblem;
using test::LinearWindow;
using Method = Linearizer::Method;

class Marginalization : public testing::TestWithParam<Method> {};
INSTANTIATE_TEST_SUITE_P(BothWays, Marginalization,
                         testing::Values(Method::schur, Method::square_root),
                         [](const auto& param) {
                           return param.param == Method::schur ? "Schur" : "SquareRoot";
                         });

/// JᵀJ and Jᵀr of a prior, in the columns of its blocks in the problem.
MatrixXd normal_equations_in(const LinearProblem& problem, const Prior& prior) {
  const Index n = problem.columns();
  MatrixXd J = MatrixXd::Zero(prior.r.size(), n);
  Index from = 0;
  for (const auto& kept : prior.kept) {
    const int tangent = kept.block.tangent();
    J.middleCols(problem.column(kept.block.data), tangent) = prior.J.middleCols(from, tangent);
    from += tangent;
  }
  MatrixXd Hb(n, n + 1);
  Hb << J.transpose() * J, J.transpose() * prior.r;
  return Hb;
}

/// Dense Schur complement: [H b] without the given blocks, whose entries are zero.
MatrixXd without(const LinearProblem& problem, const MatrixXd& Hb,
                 const std::vector<double*>& drop) {
  std::vector<Index> gone;
  std::vector<Index> stay;
  for (const double* d : drop) {
    for (Index i = 0; i < problem.block(d).tangent(); ++i) gone.push_back(problem.column(d) + i);
  }
  for (Index i = 0; i < Hb.rows(); ++i) {
    if (std::ranges::find(gone, i) == gone.end()) stay.push_back(i);
  }
  std::vector<Index> all = stay;
  all.push_back(Hb.cols() - 1);
  MatrixXd result = MatrixXd::Zero(Hb.rows(), Hb.cols());
  result(stay, all) =
      Hb(stay, all) -
      Hb(stay, gone) *
          Hb(gone, gone).completeOrthogonalDecomposition().solve(MatrixXd(Hb(gone, all)));
  return result;
}

TEST_P(Marginalization, ThenSolvingEqualsJointSolution) {
  LinearWindow window(1, 5, 30);
  LinearProblem& problem = window.problem;
  const VectorXd expected = problem.solution();
  std::vector<double*> drop{window.poses[0], window.motions[0]};
  for (std::size_t l = 0; l < window.landmarks.size(); l += 5) drop.push_back(window.landmarks[l]);
  Linearizer linearizer;
  problem.move_terms(drop, linearizer);
  const Prior prior = linearizer.marginalize(drop, GetParam());
  problem.add_prior(prior);
  const VectorXd actual = problem.solution();
  int compared = 0;
  for (const auto& kept : prior.kept) {
    const Index c = problem.column(kept.block.data);
    EXPECT_LT((actual - expected).segment(c, kept.block.tangent()).norm(), 1e-9);
    ++compared;
  }
  EXPECT_EQ(compared, 29) << "four poses, one motion and the landmarks of frame 0";
  for (const double* motion : {window.motions[2], window.motions[4]}) {
    EXPECT_LT((actual - expected).segment<9>(problem.column(motion)).norm(), 1e-9);
  }
}

TEST_P(Marginalization, FrameByFrameEqualsJointSolution) {
  LinearWindow window(2, 6, 24);
  LinearProblem& problem = window.problem;
  const VectorXd expected = problem.solution();
  for (std::size_t k = 0; k + 1 < window.poses.size(); ++k) {
    std::vector<double*> drop{window.poses[k], window.motions[k]};
    for (std::size_t l = k; l < window.landmarks.size(); l += 6) {
      drop.push_back(window.landmarks[l]);
    }
    Linearizer linearizer;
    problem.move_terms(drop, linearizer);
    problem.add_prior(linearizer.marginalize(drop, GetParam()));
  }
  const VectorXd actual = problem.solution();
  const Index pose = problem.column(window.poses.back());
  const Index motion = problem.column(window.motions.back());
  EXPECT_LT((actual - expected).segment<6>(pose).norm(), 1e-9);
  EXPECT_LT((actual - expected).segment<9>(motion).norm(), 1e-9);
}

TEST_P(Marginalization, EqualsDenseSchurComplement) {
  LinearProblem problem(3);
  std::vector<double*> blocks;
  for (const int size : {7, 6, 1, 4, 9, 1, 7, 13, 1}) blocks.push_back(problem.add_block(size));
  for (int t = 0; t < 12; ++t) {
    std::vector<double*> touched;
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      if (problem.random.uniform(0.0, 1.0) < 0.5) touched.push_back(blocks[i]);
    }
    if (!touched.empty()) problem.add_random_term(touched, 2 + t % 7);
  }
  problem.add_random_term(blocks, 60);
  const MatrixXd Hb = problem.normal_equations();
  const std::vector<double*> drop{blocks[0], blocks[2], blocks[4], blocks[5]};
  Linearizer linearizer;
  problem.move_terms(blocks, linearizer);
  const MatrixXd actual = normal_equations_in(problem, linearizer.marginalize(drop, GetParam()));
  EXPECT_LT((actual - without(problem, Hb, drop)).norm(), 1e-9 * Hb.norm());
}

TEST_P(Marginalization, EliminatesPointDepthsBeforeTheTimeOffset) {
  LinearWindow window(4, 4, 12);
  LinearProblem& problem = window.problem;
  double* const offset = problem.add_block(1);
  for (double* landmark : window.landmarks) {
    problem.add_random_term({window.poses[1], landmark, offset}, 2);
  }
  const MatrixXd Hb = problem.normal_equations();
  std::vector<double*> drop = window.landmarks;
  drop.push_back(offset);
  Linearizer linearizer;
  std::vector<double*> all = window.poses;
  all.push_back(offset);
  problem.move_terms(all, linearizer);
  const MatrixXd actual = normal_equations_in(problem, linearizer.marginalize(drop, GetParam()));
  EXPECT_LT((actual - without(problem, Hb, drop)).norm(), 1e-9 * Hb.norm());
}

// Differences of neighbors only: the common offset is unobservable.
LinearProblem chain_of_differences(std::vector<double*>& blocks) {
  LinearProblem problem(5);
  for (int k = 0; k < 6; ++k) blocks.push_back(problem.add_block(6));
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    for (std::size_t l = k + 1; l < blocks.size(); l += 1 + k) {
      const MatrixXd D = test::random_matrix(problem.random, 8, 6);
      MatrixXd J(8, 12);
      J << D, -D;
      problem.add_term({blocks[k], blocks[l]}, J);
    }
  }
  return problem;
}

TEST_P(Marginalization, AddsNoInformationToUnobservableDirections) {
  std::vector<double*> blocks;
  LinearProblem problem = chain_of_differences(blocks);
  const std::vector<double*> drop{blocks[0], blocks[3]};
  Linearizer linearizer;
  problem.move_terms(blocks, linearizer);
  const Prior prior = linearizer.marginalize(drop, GetParam());
  ASSERT_EQ(prior.kept.size(), 4U);
  const MatrixXd shift = MatrixXd::Identity(6, 6).replicate(4, 1);
  EXPECT_LT((prior.J * shift).norm(), 1e-12 * prior.J.norm());
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(prior.J.transpose() * prior.J);
  const VectorXd values = eigen.eigenvalues() / eigen.eigenvalues().maxCoeff();
  EXPECT_GE(values.minCoeff(), -1e-14);
  EXPECT_LT(values(5), 1e-12);
  EXPECT_GT(values(6), 1e-4) << "observable directions keep their information";
}

TEST_P(Marginalization, OfASingularBlockEqualsGeneralizedSchurComplement) {
  LinearProblem problem(6);
  double* const a = problem.add_block(7);
  double* const b = problem.add_block(9);
  double* const depth = problem.add_block(1);
  // Two of the six directions of a, and the depth, are unobserved.
  MatrixXd J = test::random_matrix(problem.random, 10, 16);
  J.col(1) = 2.0 * J.col(0);
  J.col(4).setZero();
  J.rightCols(1).setZero();
  problem.add_term({a, b, depth}, J);
  const MatrixXd Hb = problem.normal_equations();
  Linearizer linearizer;
  problem.move_terms({a}, linearizer);
  const Prior prior = linearizer.marginalize({a, depth}, GetParam());
  ASSERT_EQ(prior.kept.size(), 1U);
  EXPECT_TRUE(prior.J.allFinite());
  EXPECT_LT((normal_equations_in(problem, prior) - without(problem, Hb, {a, depth})).norm(),
            1e-10 * Hb.norm());
}

TEST_P(Marginalization, OfAllBlocksGivesAnEmptyPrior) {
  LinearWindow window(7, 2, 3);
  std::vector<double*> drop = window.poses;
  drop.insert(drop.end(), window.motions.begin(), window.motions.end());
  drop.insert(drop.end(), window.landmarks.begin(), window.landmarks.end());
  Linearizer linearizer;
  window.problem.move_terms(drop, linearizer);
  EXPECT_TRUE(linearizer.marginalize(drop, GetParam()).kept.empty());
  EXPECT_TRUE(Linearizer().marginalize({}, GetParam()).kept.empty());
}

TEST_P(Marginalization, ExcludesConstantBlocksInAnyCallOrder) {
  LinearWindow window(8, 3, 6);
  const auto prior_with = [&](bool early) {
    LinearWindow copy(8, 3, 6);
    Linearizer linearizer;
    if (early) linearizer.hold_constant(copy.poses[1]);
    std::vector<double*> drop{copy.poses[0], copy.motions[0]};
    copy.problem.move_terms(drop, linearizer);
    if (!early) linearizer.hold_constant(copy.poses[1]);
    const Prior prior = linearizer.marginalize(drop, GetParam());
    for (const auto& kept : prior.kept) EXPECT_NE(kept.block.data, copy.poses[1]);
    return prior;
  };
  const Prior early = prior_with(true);
  const Prior late = prior_with(false);
  EXPECT_GT(early.J.norm(), 0.0);
  EXPECT_TRUE((early.J.transpose() * early.J).isApprox(late.J.transpose() * late.J, 1e-12));
}

TEST(Linearizer, MarginalInformationOfOnePose) {
  LinearWindow window(9, 5, 20);
  LinearProblem& problem = window.problem;
  const Index n = problem.columns();
  const MatrixXd covariance = problem.normal_equations().leftCols(n).inverse();
  std::vector<double*> everything = window.poses;
  everything.insert(everything.end(), window.landmarks.begin(), window.landmarks.end());
  Linearizer linearizer;
  problem.move_terms(everything, linearizer);
  for (const double* pose : window.poses) {
    const Index c = problem.column(pose);
    const MatrixXd expected = covariance.block<6, 6>(c, c).inverse();
    const MatrixXd actual = linearizer.marginal_information(pose);
    EXPECT_LT((actual - expected).norm(), 1e-9 * expected.norm());
    EXPECT_EQ(actual, actual.transpose());
  }
}

TEST(Linearizer, PoseWithoutTermsHasZeroInformation) {
  LinearWindow window(10, 2, 2);
  Linearizer linearizer;
  window.problem.move_terms(window.poses, linearizer);
  const double* const other = window.problem.add_block(7);
  EXPECT_TRUE(linearizer.marginal_information(other).isZero(0.0));
}

TEST(Linearizer, RejectsNonFiniteTerms) {
  LinearProblem problem(11);
  double* const pose = problem.add_block(7);
  problem.add_random_term({pose}, 6);
  Prior broken = *problem.terms[0].content;
  broken.r(2) = std::numeric_limits<double>::quiet_NaN();
  Linearizer linearizer;
  EXPECT_FALSE(linearizer.add(PriorFactor(std::make_shared<Prior>(broken)), nullptr,
                              problem.terms[0].blocks));
  EXPECT_TRUE(linearizer.marginal_information(pose).isZero(0.0));
  EXPECT_TRUE(linearizer.add(*problem.terms[0].cost, nullptr, problem.terms[0].blocks));
  EXPECT_GT(linearizer.marginal_information(pose).trace(), 0.0);
}

// JᵀJ and Jᵀr from Ceres with this loss.
MatrixXd normal_equations_of_ceres(LinearProblem& problem, ceres::LossFunction& loss,
                                   std::vector<double*>& blocks) {
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem ceres_problem(options);
  for (const auto& term : problem.terms) {
    std::vector<double*> data;
    for (const Block& b : term.blocks) data.push_back(b.data);
    ceres_problem.AddResidualBlock(term.cost.get(), &loss, data);
  }
  ceres_problem.SetManifold(blocks[0], new PoseManifold);
  std::vector<double> residuals;
  ceres::CRSMatrix crs;
  ceres::Problem::EvaluateOptions evaluate;
  evaluate.parameter_blocks = blocks;
  ceres_problem.Evaluate(evaluate, nullptr, &residuals, nullptr, &crs);
  MatrixXd J = MatrixXd::Zero(crs.num_rows, crs.num_cols);
  for (int row = 0; row < crs.num_rows; ++row) {
    for (int k = crs.rows[static_cast<std::size_t>(row)];
         k < crs.rows[static_cast<std::size_t>(row) + 1]; ++k) {
      J(row, crs.cols[static_cast<std::size_t>(k)]) = crs.values[static_cast<std::size_t>(k)];
    }
  }
  const Eigen::Map<const VectorXd> r(residuals.data(), J.rows());
  MatrixXd Hb(J.cols(), J.cols() + 1);
  Hb << J.transpose() * J, J.transpose() * r;
  return Hb;
}

TEST(Linearizer, AppliesRobustLossesLikeCeres) {
  ceres::HuberLoss huber(0.8);
  ceres::CauchyLoss cauchy(1.3);
  ceres::TolerantLoss tolerant(2.0, 0.7);  // convex in the squared norm
  for (ceres::LossFunction* loss :
       std::initializer_list<ceres::LossFunction*>{&huber, &cauchy, &tolerant}) {
    LinearProblem problem(12);
    std::vector<double*> blocks{problem.add_block(7), problem.add_block(3)};
    for (int t = 0; t < 20; ++t) problem.add_random_term(blocks, 2);
    Linearizer linearizer;
    for (const auto& term : problem.terms) linearizer.add(*term.cost, loss, term.blocks);
    const Prior prior = linearizer.marginalize({}, Method::schur);
    const MatrixXd expected = normal_equations_of_ceres(problem, *loss, blocks);
    EXPECT_LT((normal_equations_in(problem, prior) - expected).norm(), 1e-12 * expected.norm());
  }
}

TEST(PriorFactor, JacobianMatchesNumericDifferencesAtItsState) {
  LinearProblem problem(13);
  const std::vector<double*> blocks{problem.add_block(7), problem.add_block(9),
                                    problem.add_block(1)};
  problem.add_random_term(blocks, 8);
  test::Values values;
  for (const double* b : blocks) values.emplace_back(b, b + problem.block(b).size);
  test::expect_jacobians(*problem.terms[0].cost, values, 1e-8);
}

TEST(PriorFactor, KeepsItsJacobianAndUpdatesItsResidual) {
  LinearProblem problem(14);
  double* const pose = problem.add_block(7);
  problem.add_random_term({pose}, 6);
  const Prior& prior = *problem.terms[0].content;
  VectorXd delta(6);
  delta << 0.2, -0.1, 0.3, 1.0, 2.0, -1.0;
  const test::Values moved{test::plus(std::vector<double>(pose, pose + 7), delta)};
  EXPECT_TRUE(test::residual(*problem.terms[0].cost, moved).isApprox(prior.r + prior.J * delta));
  EXPECT_EQ(test::analytic_jacobian(*problem.terms[0].cost, moved, 0), prior.J);
}

TEST(Prior, RelocateUpdatesBlockAddresses) {
  LinearProblem problem(15);
  double* const a = problem.add_block(7);
  double* const b = problem.add_block(9);
  problem.add_random_term({a, b}, 5);
  Prior prior = *problem.terms[0].content;
  std::vector<double> house(7);
  prior.relocate(a, house.data());
  prior.relocate(problem.add_block(7), nullptr);
  EXPECT_EQ(prior.kept[0].block.data, house.data());
  EXPECT_EQ(prior.kept[1].block.data, b);
}

}  // namespace
}  // namespace apvi::vio
