// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "apvi/config/node.hpp"
#include "apvi/geometry/se3.hpp"

namespace apvi {

/// The pose of a 4x4 matrix, row by row; the identity for a null node. Throws InputError with file
/// and line for what is not a rigid transform.
SE3 to_pose(const config::Node& node, const std::string& key);

}  // namespace apvi
