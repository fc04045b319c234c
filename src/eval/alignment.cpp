// SPDX-License-Identifier: BSD-3-Clause
#include "eval/alignment.hpp"

#include <Eigen/Geometry>

#include "geometry/umeyama.hpp"

namespace apvi::eval {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Points = std::vector<Vector3d>;

Eigen::Map<const Matrix3Xd> as_matrix(const Points& points) {
  return {points.front().data(), 3, static_cast<Eigen::Index>(points.size())};
}

Fit fit_rigid(const Points& source, const Points& target) {
  if (const auto motion = align_rigid(source, target)) return {*motion};
  const Eigen::Matrix4d m = Eigen::umeyama(as_matrix(source), as_matrix(target), false);
  const Eigen::Matrix3d rotation = m.topLeftCorner<3, 3>();
  return {{Eigen::Quaterniond(rotation).normalized(), m.topRightCorner<3, 1>()}, false};
}

Fit fit_yaw(const Points& source, const Points& target) {
  if (const auto motion = align_yaw(source, target)) return {*motion};
  const Vector3d offset = as_matrix(target).rowwise().mean() - as_matrix(source).rowwise().mean();
  return {{Eigen::Quaterniond::Identity(), offset}, false};
}

}  // namespace

Fit fit(const std::vector<PosePair>& pairs, Alignment alignment, bool planar) {
  if (alignment == Alignment::none) return {};
  if (alignment == Alignment::first) {
    return {pairs.front().reference * pairs.front().estimate.inverse()};
  }
  Points source;
  Points target;
  for (const PosePair& pair : pairs) {
    source.push_back(pair.estimate.translation);
    target.push_back(pair.reference.translation);
  }
  const bool about_vertical = planar || alignment == Alignment::yaw;
  return about_vertical ? fit_yaw(source, target) : fit_rigid(source, target);
}

}  // namespace apvi::eval
