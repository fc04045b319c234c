// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/marginal_covariance.hpp"

#include <ceres/ceres.h>
#include <gtest/gtest.h>

#include <array>
#include <utility>
#include <vector>

namespace apvi::loop_closure {
namespace {

// Joins two blocks of two values and a quaternion by a curved function.
struct Curved {
  template <typename T>
  bool operator()(const T* a, const T* b, const T* q, T* error) const {
    error[0] = T(3.0) * a[0] + b[0] * b[1];
    error[1] = a[1] * q[0] - T(2.0) * b[1];
    error[2] = b[0] + q[1] * a[0];
    error[3] = q[2] + T(0.5) * q[3] * a[1];
    return true;
  }
};

struct AtRest {
  template <typename T>
  bool operator()(const T* values, T* error) const {
    error[0] = T(2.0) * values[0];
    error[1] = T(0.7) * values[1];
    return true;
  }
};

struct OneOfTwo {
  template <typename T>
  bool operator()(const T* values, T* error) const {
    error[0] = values[0];
    return true;
  }
};

struct SmallProblem {
  SmallProblem() {
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Curved, 4, 2, 2, 4>(new Curved),
                             new ceres::CauchyLoss(1.0), a.data(), b.data(), q.data());
    for (double* values : {a.data(), b.data()}) {
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<AtRest, 2, 2>(new AtRest), nullptr,
                               values);
    }
    problem.SetManifold(q.data(), new ceres::EigenQuaternionManifold);
  }
  std::array<double, 2> a{0.3, -0.2};
  std::array<double, 2> b{0.5, 0.8};
  std::array<double, 4> q{0.1, 0.2, 0.3, 0.9273618495495703};
  ceres::Problem problem;
};

TEST(MarginalCovariance, IsThatOfCeres) {
  SmallProblem small;
  const auto found = marginal_covariance(small.problem, {small.b.data(), small.a.data()});
  ASSERT_TRUE(found);
  ceres::Covariance::Options options;
  options.algorithm_type = ceres::DENSE_SVD;
  ceres::Covariance oracle(options);
  ASSERT_TRUE(oracle.Compute(
      std::vector<std::pair<const double*, const double*>>{{small.a.data(), small.a.data()},
                                                           {small.a.data(), small.b.data()},
                                                           {small.b.data(), small.b.data()}},
      &small.problem));
  Eigen::Matrix<double, 4, 4, Eigen::RowMajor> expected;
  Eigen::Matrix<double, 2, 2, Eigen::RowMajor> block;
  const auto covariance_of = [&](const double* row, const double* column) {
    oracle.GetCovarianceBlockInTangentSpace(row, column, block.data());
    return block;
  };
  expected.topLeftCorner<2, 2>() = covariance_of(small.b.data(), small.b.data());
  expected.topRightCorner<2, 2>() = covariance_of(small.a.data(), small.b.data()).transpose();
  expected.bottomLeftCorner<2, 2>() = covariance_of(small.a.data(), small.b.data());
  expected.bottomRightCorner<2, 2>() = covariance_of(small.a.data(), small.a.data());
  EXPECT_LT((*found - expected).norm(), 1e-9 * expected.norm());
}

TEST(MarginalCovariance, OfAConstantBlockIsZero) {
  SmallProblem small;
  small.problem.SetParameterBlockConstant(small.a.data());
  const auto found = marginal_covariance(small.problem, {small.a.data(), small.b.data()});
  ASSERT_TRUE(found);
  EXPECT_EQ(found->topRows<2>().norm(), 0.0);
  EXPECT_EQ(found->leftCols<2>().norm(), 0.0);
  const Eigen::Matrix2d of_b = found->bottomRightCorner<2, 2>();
  EXPECT_GT(of_b.determinant(), 0.0);
}

TEST(MarginalCovariance, NeedsAProblemThatDeterminesEverything) {
  std::array<double, 2> free{1.0, 2.0};
  ceres::Problem problem;
  problem.AddResidualBlock(new ceres::AutoDiffCostFunction<OneOfTwo, 1, 2>(new OneOfTwo), nullptr,
                           free.data());
  EXPECT_FALSE(marginal_covariance(problem, {free.data()}));
}

}  // namespace
}  // namespace apvi::loop_closure
