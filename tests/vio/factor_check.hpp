// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/cost_function.h>
#include <gtest/gtest.h>

#include <vector>

#include "core/random.hpp"
#include "support/numeric_jacobian.hpp"
#include "support/spline_imu.hpp"
#include "vio/factors/factors.hpp"

/// Compares analytic with numeric Jacobians of cost functions, by the tangent.
namespace apvi::vio::test {

using Values = std::vector<std::vector<double>>;  ///< one entry per parameter block

inline std::vector<double> as_vector(const PoseBlock& b) {
  return {b.begin(), b.end()};
}
inline std::vector<double> as_vector(const MotionBlock& b) {
  return {b.begin(), b.end()};
}

inline std::vector<const double*> pointers(const Values& values) {
  std::vector<const double*> result;
  for (const auto& v : values) result.push_back(v.data());
  return result;
}

inline Eigen::VectorXd residual(const ceres::CostFunction& cost, const Values& values) {
  Eigen::VectorXd r(cost.num_residuals());
  EXPECT_TRUE(cost.Evaluate(pointers(values).data(), r.data(), nullptr));
  return r;
}

inline int tangent_of(const std::vector<double>& block) {
  return block.size() == 7 ? 6 : static_cast<int>(block.size());
}

inline std::vector<double> plus(const std::vector<double>& x, const Eigen::VectorXd& delta) {
  std::vector<double> result(x.size());
  if (x.size() == 7) {
    PoseManifold().Plus(x.data(), delta.data(), result.data());
  } else {
    for (std::size_t i = 0; i < x.size(); ++i) {
      result[i] = x[i] + delta(static_cast<Eigen::Index>(i));
    }
  }
  return result;
}

/// Requests the Jacobian of one block only; all others are null, as if constant.
inline Eigen::MatrixXd analytic_jacobian(const ceres::CostFunction& cost, const Values& values,
                                         std::size_t block) {
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto size = static_cast<Eigen::Index>(values[block].size());
  // Entries that are not written are detected by an impossible value.
  RowMajor J = RowMajor::Constant(cost.num_residuals(), size, 1e77);
  std::vector<double*> jacobians(values.size(), nullptr);
  if (size == 1) {
    std::vector<double> column(static_cast<std::size_t>(cost.num_residuals()), 1e77);
    jacobians[block] = column.data();
    Eigen::VectorXd r(cost.num_residuals());
    EXPECT_TRUE(cost.Evaluate(pointers(values).data(), r.data(), jacobians.data()));
    return Eigen::Map<Eigen::VectorXd>(column.data(), cost.num_residuals());
  }
  jacobians[block] = J.data();
  Eigen::VectorXd r(cost.num_residuals());
  EXPECT_TRUE(cost.Evaluate(pointers(values).data(), r.data(), jacobians.data()));
  EXPECT_TRUE(r.isApprox(residual(cost, values), 1e-14));
  if (size == 7) {
    EXPECT_TRUE(J.col(6).isZero(0.0)) << "the seventh column must be zero";
  }
  return J.leftCols(tangent_of(values[block]));
}

inline Eigen::MatrixXd numeric_jacobian_of(const ceres::CostFunction& cost, const Values& values,
                                           std::size_t block) {
  const auto f = [&](const Eigen::VectorXd& delta) {
    Values moved = values;
    moved[block] = plus(values[block], delta);
    return residual(cost, moved);
  };
  return apvi::test::numeric_jacobian(f, tangent_of(values[block]), 3e-6);
}

/// Compares row by row, as rows of a whitened residual differ in scale.
inline void expect_near_by_row(const Eigen::MatrixXd& actual, const Eigen::MatrixXd& expected,
                               const Eigen::VectorXd& row_scale, double tolerance) {
  ASSERT_EQ(actual.rows(), expected.rows());
  for (Eigen::Index i = 0; i < actual.rows(); ++i) {
    const double difference = (actual.row(i) - expected.row(i)).cwiseAbs().maxCoeff();
    EXPECT_LE(difference, tolerance * row_scale(i)) << "row " << i << " is\n"
                                                    << actual.row(i) << "\nand should be\n"
                                                    << expected.row(i);
  }
}

/// Expects the Jacobians of `cost` (possibly with first estimates) at `values` to match numeric
/// ones of `plain` at `expected_at`.
inline void expect_jacobians(const ceres::CostFunction& cost, const Values& values,
                             const ceres::CostFunction& plain, const Values& expected_at,
                             double tolerance = 1e-7) {
  std::vector<Eigen::MatrixXd> expected;
  Eigen::VectorXd scale = Eigen::VectorXd::Constant(cost.num_residuals(), 1e-12);
  for (std::size_t block = 0; block < values.size(); ++block) {
    expected.push_back(numeric_jacobian_of(plain, expected_at, block));
    scale = scale.cwiseMax(expected.back().cwiseAbs().rowwise().maxCoeff());
  }
  for (std::size_t block = 0; block < values.size(); ++block) {
    SCOPED_TRACE("block " + std::to_string(block));
    expect_near_by_row(analytic_jacobian(cost, values, block), expected[block], scale, tolerance);
  }
}

inline void expect_jacobians(const ceres::CostFunction& cost, const Values& values,
                             double tolerance = 1e-7) {
  expect_jacobians(cost, values, cost, values, tolerance);
}

inline SE3 random_pose(Random& random, double angle, double distance) {
  return {so3::exp(apvi::test::random_vector(random, angle)),
          apvi::test::random_vector(random, distance)};
}

inline MotionBlock random_motion(Random& random) {
  MotionBlock motion{};
  for (std::size_t i = 0; i < 3; ++i) {
    motion[i] = random.uniform(-1.0, 1.0);
    motion[i + 3] = random.uniform(-0.05, 0.05);
    motion[i + 6] = random.uniform(-0.3, 0.3);
  }
  return motion;
}

/// A perturbed state.
inline std::vector<double> nudged(const std::vector<double>& x, Random& random, double size) {
  Eigen::VectorXd delta(tangent_of(x));
  for (double& d : delta) d = random.uniform(-size, size);
  return plus(x, delta);
}

inline PoseBlock as_pose(const std::vector<double>& x) {
  PoseBlock block{};
  std::copy(x.begin(), x.end(), block.begin());
  return block;
}
inline MotionBlock as_motion(const std::vector<double>& x) {
  MotionBlock block{};
  std::copy(x.begin(), x.end(), block.begin());
  return block;
}

}  // namespace apvi::vio::test
