// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/umeyama.hpp"

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <cmath>

#include "apvi/core/error.hpp"

namespace apvi {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Eigen::Matrix3Xd to_matrix(const std::vector<Vector3d>& points) {
  return Eigen::Map<const Eigen::Matrix3Xd>(points.front().data(), 3,
                                            static_cast<Eigen::Index>(points.size()));
}

Vector3d mean(const std::vector<Vector3d>& points) {
  return to_matrix(points).rowwise().mean();
}

// The ratio of the second singular value to the first is zero for collinear points.
bool spans_plane(const Eigen::Matrix3Xd& points) {
  const Eigen::Matrix3Xd centered = points.colwise() - points.rowwise().mean();
  const Vector3d s = Eigen::JacobiSVD<Matrix3d>(centered * centered.transpose()).singularValues();
  return s(1) > 1e-12 * s(0) && s(0) > 0.0;
}

// The transform as a matrix; nullopt when the points do not determine it.
std::optional<Eigen::Matrix4d> align(const std::vector<Vector3d>& source,
                                     const std::vector<Vector3d>& target, bool with_scale) {
  APVI_CHECK(source.size() == target.size());
  if (source.size() < 3) return std::nullopt;
  const Eigen::Matrix3Xd from = to_matrix(source);
  const Eigen::Matrix3Xd to = to_matrix(target);
  if (!spans_plane(from) || !spans_plane(to)) return std::nullopt;
  return Eigen::umeyama(from, to, with_scale);
}

}  // namespace

std::optional<SE3> align_rigid(const std::vector<Vector3d>& source,
                               const std::vector<Vector3d>& target) {
  const auto m = align(source, target, false);
  if (!m) return std::nullopt;
  return SE3{Eigen::Quaterniond(Matrix3d(m->topLeftCorner<3, 3>())).normalized(),
             m->topRightCorner<3, 1>()};
}

std::optional<double> similarity_scale(const std::vector<Vector3d>& source,
                                       const std::vector<Vector3d>& target) {
  const auto m = align(source, target, true);
  return m ? std::optional(m->col(0).head<3>().norm()) : std::nullopt;
}

std::optional<SE3> align_yaw(const std::vector<Vector3d>& source,
                             const std::vector<Vector3d>& target) {
  APVI_CHECK(source.size() == target.size());
  if (source.size() < 2) return std::nullopt;
  const Vector3d from_mean = mean(source);
  const Vector3d to_mean = mean(target);
  double cosine = 0.0;
  double sine = 0.0;
  for (std::size_t i = 0; i < source.size(); ++i) {
    const Vector3d a = source[i] - from_mean;
    const Vector3d b = target[i] - to_mean;
    cosine += a.x() * b.x() + a.y() * b.y();
    sine += a.x() * b.y() - a.y() * b.x();
  }
  if (std::hypot(cosine, sine) < 1e-12) return std::nullopt;
  const Eigen::Quaterniond rotation(Eigen::AngleAxisd(std::atan2(sine, cosine), Vector3d::UnitZ()));
  return SE3{rotation, to_mean - rotation * from_mean};
}

}  // namespace apvi
