// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "support/spline_imu.hpp"
#include "vio/factors/factors.hpp"
#include "vio/marginalization/marginalization.hpp"

/// A window of frames along a smooth curve, with inertial terms between them and landmarks observed
/// by later frames: a typical problem of the estimator.
namespace apvi::vio::test {

struct CameraWindow {
  struct Landmark {
    std::size_t anchor;
    Eigen::Vector3d ray;  ///< in the anchor, z = 1
    double inverse_depth;
  };

  Eigen::Vector3d gravity{0.0, 0.0, -9.80665};
  std::vector<FrameState> frames;
  std::vector<FirstEstimate> first;  ///< one per frame, empty
  std::vector<std::shared_ptr<const imu::Preintegration>> between;
  std::vector<Landmark> landmarks;
  PoseBlock camera =
      to_block({so3::exp(Eigen::Vector3d(-1.2, 1.1, -1.3)), Eigen::Vector3d(0.1, -0.05, 0.2)});
  double offset_s = 0.0;
  LensBlock lens{};

  CameraWindow(std::size_t count, std::size_t points, double period_s, std::size_t anchors) {
    const Se3Spline spline = apvi::test::wavy_spline(21, period_s * static_cast<double>(count));
    const auto samples = apvi::test::imu_along(spline, gravity, 200.0);
    const auto stride = static_cast<std::size_t>(period_s * 200.0);
    for (std::size_t k = 0; k < count; ++k) {
      const Motion m = spline.at(samples[k * stride].stamp);
      FrameState state{.pose = to_block(m.T_world_body), .motion = {}};
      Eigen::Map<Eigen::Vector3d>(state.motion.data()) = m.velocity_world;
      frames.push_back(state);
      if (k == 0) continue;
      auto sum = std::make_shared<imu::Preintegration>(imu::Noise{}, Eigen::Vector3d::Zero(),
                                                       Eigen::Vector3d::Zero());
      for (std::size_t i = (k - 1) * stride; i < k * stride; ++i) {
        sum->integrate(samples[i], samples[i + 1]);
      }
      between.push_back(sum);
    }
    first.resize(count);
    Random random(22);
    for (std::size_t l = 0; l < points; ++l) {
      landmarks.push_back({l % anchors,
                           {random.uniform(-0.5, 0.5), random.uniform(-0.4, 0.4), 1.0},
                           1.0 / random.uniform(1.5, 6.0)});
    }
  }

  Eigen::Vector2d seen(const Landmark& landmark, std::size_t frame) const {
    const SE3 T_body_camera = to_se3(camera.data());
    const SE3 a = to_se3(frames[landmark.anchor].pose.data()) * T_body_camera;
    const SE3 b = to_se3(frames[frame].pose.data()) * T_body_camera;
    return (b.inverse() * (a * (landmark.ray / landmark.inverse_depth))).hnormalized();
  }

  /// The observation of a landmark by `frame`, as a term at the current values.
  std::unique_ptr<ReprojectionFactor> view_of(const Landmark& landmark, std::size_t frame,
                                              bool use_first) const {
    return std::make_unique<ReprojectionFactor>(
        ReprojectionFactor::View{landmark.ray.head<2>()},
        ReprojectionFactor::View{seen(landmark, frame)}, 300.0,
        use_first ? &first[landmark.anchor] : nullptr, use_first ? &first[frame] : nullptr);
  }
  std::vector<Block> view_blocks(Landmark& landmark, std::size_t frame) {
    return {{frames[landmark.anchor].pose.data(), 7},
            {frames[frame].pose.data(), 7},
            {camera.data(), 7},
            {&landmark.inverse_depth, 1},
            {&offset_s, 1},
            {lens.data(), kLensSize}};
  }
  std::unique_ptr<ImuFactor> inertial(std::size_t from, bool use_first) const {
    return std::make_unique<ImuFactor>(between[from], gravity, use_first ? &first[from] : nullptr,
                                       use_first ? &first[from + 1] : nullptr);
  }
  std::vector<Block> inertial_blocks(std::size_t from) {
    return {{frames[from].pose.data(), 7},
            {frames[from].motion.data(), 9},
            {frames[from + 1].pose.data(), 7},
            {frames[from + 1].motion.data(), 9}};
  }

  /// All terms of `frame`, the oldest, and of landmarks anchored there; and the blocks that are
  /// dropped with it.
  std::vector<double*> add_oldest(std::size_t frame, bool use_first, Linearizer& to) {
    to.hold_constant(camera.data());
    to.hold_constant(&offset_s);
    to.hold_constant(lens.data());
    std::vector<double*> drop{frames[frame].pose.data(), frames[frame].motion.data()};
    to.add(*inertial(frame, use_first), nullptr, inertial_blocks(frame));
    for (Landmark& landmark : landmarks) {
      if (landmark.anchor != frame) continue;
      drop.push_back(&landmark.inverse_depth);
      for (std::size_t k = frame + 1; k < frames.size(); ++k) {
        to.add(*view_of(landmark, k, use_first), nullptr, view_blocks(landmark, k));
      }
    }
    return drop;
  }
};

}  // namespace apvi::vio::test
