// SPDX-License-Identifier: BSD-3-Clause
// Position and heading are unobservable with camera and IMU. A marginalization prior must not
// contain information about them, at any linearization point.
#include <gtest/gtest.h>

#include "vio/camera_window.hpp"
#include "vio/factor_check.hpp"

namespace apvi::vio {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using test::CameraWindow;
using Method = Linearizer::Method;

void nudge(FrameState& state, Random& random, double size) {
  state.pose = test::as_pose(test::nudged(test::as_vector(state.pose), random, size));
  state.motion = test::as_motion(test::nudged(test::as_vector(state.motion), random, size));
}

/// The prior after marginalizing two frames one after the other, with the estimate changing in
/// between.
Prior prior_after_two_frames(CameraWindow& window, bool use_first, Method method) {
  Random random(23);
  for (FrameState& state : window.frames) nudge(state, random, 0.01);
  Linearizer oldest;
  const auto drop = window.add_oldest(0, use_first, oldest);
  const auto prior = std::make_shared<Prior>(oldest.marginalize(drop, method));
  for (std::size_t k = 1; k < window.frames.size(); ++k) {
    window.first[k].pose = window.frames[k].pose;
  }
  window.first[1].motion = window.frames[1].motion;
  for (FrameState& state : window.frames) nudge(state, random, 0.03);
  Linearizer next;
  const auto drop_next = window.add_oldest(1, use_first, next);
  const PriorFactor factor(prior);
  std::vector<Block> blocks;
  for (const auto& kept : prior->kept) blocks.push_back(kept.block);
  next.add(factor, nullptr, blocks);
  return next.marginalize(drop_next, method);
}

/// Basis of the gauge: translation along each axis and rotation about the vertical of the whole
/// window.
MatrixXd gauge(const CameraWindow& window, const Prior& prior) {
  MatrixXd N = MatrixXd::Zero(prior.J.cols(), 4);
  const Vector3d up = Vector3d::UnitZ();
  Index row = 0;
  for (const auto& kept : prior.kept) {
    for (std::size_t k = 0; k < window.frames.size(); ++k) {
      if (kept.block.data == window.frames[k].pose.data()) {
        const auto& first = window.first[k].pose;
        const SE3 pose = to_se3(first ? first->data() : kept.block.data);
        N.block<3, 3>(row + 3, 0).setIdentity();
        N.block<3, 1>(row, 3) = pose.rotation.conjugate() * up;
        N.block<3, 1>(row + 3, 3) = up.cross(pose.translation);
      } else if (kept.block.data == window.frames[k].motion.data()) {
        N.block<3, 1>(row, 3) = up.cross(Vector3d(kept.block.data));
      }
    }
    row += kept.block.tangent();
  }
  return N;
}

/// Information of the prior about the translations [1/m²] and the heading [1/rad²].
Eigen::Vector4d information_on_gauge(const CameraWindow& window, const Prior& prior) {
  const MatrixXd claimed = prior.J * gauge(window, prior);
  return claimed.colwise().squaredNorm().transpose();
}

class Gauge : public testing::TestWithParam<Method> {};
INSTANTIATE_TEST_SUITE_P(BothWays, Gauge, testing::Values(Method::schur, Method::square_root),
                         [](const auto& param) {
                           return param.param == Method::schur ? "Schur" : "SquareRoot";
                         });

TEST_P(Gauge, IsPreservedWithFirstEstimates) {
  CameraWindow window(6, 24, 0.25, 2);
  const Prior prior = prior_after_two_frames(window, true, GetParam());
  ASSERT_EQ(prior.kept.size(), 5U) << "four poses and one motion";
  const Eigen::Vector4d claimed = information_on_gauge(window, prior);
  // The normal equations leave rounding of 1e-14 of the largest entry; QR almost none.
  EXPECT_LT(claimed.maxCoeff(), GetParam() == Method::schur ? 1e-4 : 1e-15);
  EXPECT_GT(prior.J.squaredNorm(), 1e6) << "the prior is informative otherwise";
}

TEST_P(Gauge, GetsSpuriousHeadingInformationWithoutFirstEstimates) {
  CameraWindow window(6, 24, 0.25, 2);
  const Prior prior = prior_after_two_frames(window, false, GetParam());
  const Eigen::Vector4d claimed = information_on_gauge(window, prior);
  EXPECT_LT(claimed.head<3>().maxCoeff(), 1e-4);
  EXPECT_GT(claimed(3), 1000.0) << "spurious heading information of two degrees";
}

}  // namespace
}  // namespace apvi::vio
