// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/factors.hpp"

#include <gtest/gtest.h>

#include <array>

#include "apvi/geometry/so3.hpp"
#include "support/numeric_jacobian.hpp"

namespace apvi::loop_closure {
namespace {

using RowMatrix4 = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;

const SE3 kFrom{so3::exp({0.1, -0.2, 0.7}), {1.0, 2.0, -3.0}};
const SE3 kTo{so3::exp({-0.1, 0.1, 1.5}), {4.0, 1.0, -3.5}};
const Edge kEdge{.from = 0,
                 .to = 1,
                 .T_from_to = {so3::exp({0.0, 0.1, 0.6}), {2.0, -1.0, 0.4}},
                 .sigmas = {.heading_rad = 0.01, .horizontal_m = 0.02, .vertical_m = 0.05}};
const NodeState kFromState{0.3, 1.1, 2.2, -3.1};
const NodeState kToState{-0.2, 3.8, 1.3, -3.4};

NodeState moved(NodeState state, const Eigen::VectorXd& delta) {
  for (std::size_t i = 0; i < state.size(); ++i) state[i] += delta[static_cast<Eigen::Index>(i)];
  return state;
}

Eigen::Vector4d residuals(const Edge& edge, const NodeState& from, const NodeState& to) {
  Eigen::Vector4d r;
  const std::array<const double*, 2> states{from.data(), to.data()};
  EXPECT_TRUE(EdgeFactor(edge, kFrom, kTo).Evaluate(states.data(), r.data(), nullptr));
  return r;
}

TEST(EdgeFactor, JacobiansAreThoseOfNumericDifferences) {
  RowMatrix4 from;
  RowMatrix4 to;
  Eigen::Vector4d r;
  const std::array<const double*, 2> states{kFromState.data(), kToState.data()};
  std::array<double*, 2> jacobians{from.data(), to.data()};
  EXPECT_TRUE(EdgeFactor(kEdge, kFrom, kTo).Evaluate(states.data(), r.data(), jacobians.data()));
  const auto by_from = [](const Eigen::VectorXd& d) -> Eigen::VectorXd {
    return residuals(kEdge, moved(kFromState, d), kToState);
  };
  const auto by_to = [](const Eigen::VectorXd& d) -> Eigen::VectorXd {
    return residuals(kEdge, kFromState, moved(kToState, d));
  };
  EXPECT_TRUE(from.isApprox(test::numeric_jacobian(by_from, 4), 1e-8));
  EXPECT_TRUE(to.isApprox(test::numeric_jacobian(by_to, 4), 1e-8));
}

// The corrected poses as SE(3), without the parameterization of the factor.
TEST(EdgeFactor, IsTheDifferenceOfRelativePoses) {
  const SE3 from = to_correction(kFromState, kFrom).transform() * kFrom;
  const SE3 to = to_correction(kToState, kTo).transform() * kTo;
  const Eigen::Quaterniond heading = so3::exp({0.0, 0.0, -kFromState[0]});
  const Eigen::Vector3d step = heading * (to.translation - (from * kEdge.T_from_to).translation);
  const double turn = so3::yaw(to.rotation * (from * kEdge.T_from_to).rotation.conjugate());
  const Eigen::Vector4d r = residuals(kEdge, kFromState, kToState);
  EXPECT_NEAR(r[0], step.x() / 0.02, 1e-9);
  EXPECT_NEAR(r[1], step.y() / 0.02, 1e-9);
  EXPECT_NEAR(r[2], step.z() / 0.05, 1e-9);
  EXPECT_NEAR(r[3], turn / 0.01, 2.0);  // roll and pitch differ a little
}

TEST(EdgeFactor, StateAndCorrectionAreInverse) {
  const NodeState again = to_state(to_correction(kToState, kTo), kTo);
  for (std::size_t i = 0; i < again.size(); ++i) EXPECT_NEAR(again[i], kToState[i], 1e-12);
}

TEST(HeightFactor, IsTheDifferenceOfHeightInSigmas) {
  const std::array<const double*, 1> states{kToState.data()};
  Eigen::Vector4d jacobian;
  std::array<double*, 1> jacobians{jacobian.data()};
  double r = 0.0;
  EXPECT_TRUE(HeightFactor({1, 0.05}, kTo).Evaluate(states.data(), &r, jacobians.data()));
  EXPECT_NEAR(r, (-3.4 + 3.5) / 0.05, 1e-12);
  EXPECT_TRUE(jacobian.isApprox(Eigen::Vector4d(0.0, 0.0, 0.0, 20.0)));
}

}  // namespace
}  // namespace apvi::loop_closure
