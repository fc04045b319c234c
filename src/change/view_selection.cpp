// SPDX-License-Identifier: BSD-3-Clause
#include "change/view_selection.hpp"

#include <torch/torch.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "apvi/core/constants.hpp"
#include "core/median.hpp"

namespace apvi::change {
namespace {

using torch::Tensor;

constexpr std::size_t kSamples = 16;
constexpr double kSampleWidth = 80.0;  // [px]
constexpr double kOpaque = 0.5;
constexpr double kMinShift = 0.1;  // of the depth
constexpr double kMinTurn_deg = 10.0;

/// Position and optical axis of a camera.
struct Pose {
  Eigen::Vector3d center;
  Eigen::Vector3d axis;
};

Pose pose_of(const gaussians::View& view) {
  const Tensor T = view.T_camera_world.to(torch::kFloat64).contiguous();
  const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> m(T.data_ptr<double>());
  const Eigen::Matrix3d R = m.topLeftCorner<3, 3>();
  return {-R.transpose() * m.topRightCorner<3, 1>(), R.row(2)};
}

bool is_near(const Pose& a, const Pose& b, double depth_m) {
  return (a.center - b.center).norm() < kMinShift * depth_m &&
         a.axis.dot(b.axis) > std::cos(kMinTurn_deg / kDegreesPerRadian);
}

gaussians::View reduced(gaussians::View view, double focal) {
  const gaussians::Intrinsics& k = view.intrinsics;
  if (k.fx <= focal) return view;
  const double scale = focal / k.fx;
  view.intrinsics = k.scaled(std::max(1, static_cast<int>(std::lround(scale * k.width))),
                             std::max(1, static_cast<int>(std::lround(scale * k.height))));
  return view;
}

std::vector<std::size_t> distinct(const std::vector<gaussians::View>& views, double depth_m) {
  std::vector<std::size_t> kept;
  std::vector<Pose> poses;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Pose pose = pose_of(views[i]);
    const bool known = std::any_of(poses.begin(), poses.end(), [&](const Pose& other) {
      return is_near(pose, other, depth_m);
    });
    if (known) continue;
    poses.push_back(pose);
    kept.push_back(i);
  }
  return kept;
}

}  // namespace

Scale scale_of(const Session& session) {
  const mapping::Map bare{
      .gaussians = session.map.gaussians, .medium = {}, .antialiased = session.map.antialiased};
  std::vector<double> depths;
  std::vector<double> lights;
  const std::size_t stride = (session.views.size() + kSamples - 1) / kSamples;
  for (std::size_t i = 0; i < session.views.size(); i += stride) {
    const gaussians::Intrinsics& k = session.views[i].intrinsics;
    const auto drawn =
        mapping::render_map(bare, reduced(session.views[i], kSampleWidth * k.fx / k.width));
    const Tensor known = drawn.alpha >= kOpaque;
    if (!known.any().item<bool>()) continue;
    depths.push_back(drawn.depth.index({known}).median().item<double>());
    lights.push_back(drawn.restored.mean(2).index({known}).median().item<double>());
  }
  return {median(depths), median(lights)};
}

std::vector<gaussians::View> thinned_views(const Session& session, double depth_m, double pixel_m,
                                           std::size_t most) {
  const std::vector<std::size_t> kept = distinct(session.views, depth_m);
  const std::size_t stride = std::max<std::size_t>(1, (kept.size() + most - 1) / most);
  std::vector<gaussians::View> views;
  for (std::size_t i = 0; i < kept.size(); i += stride) {
    views.push_back(reduced(session.views[kept[i]], depth_m / pixel_m));
  }
  return views;
}

}  // namespace apvi::change
