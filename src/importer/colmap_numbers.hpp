// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <string>

#include "apvi/geometry/se3.hpp"

namespace apvi::importer {

/// A pose of qw, qx, qy, qz, tx, ty, tz. Throws InputError, beginning with `where`, when a number
/// is not finite or the quaternion has no direction.
SE3 to_pose(const std::array<double, 7>& pose, const std::string& where);

}  // namespace apvi::importer
