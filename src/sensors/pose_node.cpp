// SPDX-License-Identifier: BSD-3-Clause
#include "sensors/pose_node.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/geometry/so3.hpp"

namespace apvi {

SE3 to_pose(const config::Node& node, const std::string& key) {
  if (node.is_null()) return SE3::identity();
  std::vector<double> m;
  config::internal::read_value(node, key, m, config::internal::NoLimit{});
  if (m.size() != 16) fail_at(node, key, fmt::format("expected 16 numbers, got {}", m.size()));
  const auto matrix = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(m.data());
  if ((matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).norm() > 1e-6) {
    fail_at(node, key, "the last row must be 0, 0, 0, 1; the matrix must be row-major");
  }
  const Eigen::Matrix3d block = matrix.topLeftCorner<3, 3>();
  const auto rotation = so3::nearest_rotation(block);
  if (!rotation) {
    fail_at(
        node, key,
        fmt::format("the upper left 3x3 block is not a rotation (determinant {:.4f}){}",
                    block.determinant(), block.determinant() < 0.0 ? "; an axis is flipped" : ""));
  }
  return {Eigen::Quaterniond(*rotation).normalized(), matrix.topRightCorner<3, 1>()};
}

}  // namespace apvi
