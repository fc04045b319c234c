// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "apvi/geometry/trajectory.hpp"

namespace apvi::io {

/// Warns when the quaternions of a file without column names seem to have the other order, w first
/// or w last: in that one the first pose is the identity, and as read the vertical axis of the body
/// turns far from where it began. `name` is the file.
void check_quaternion_order(const Trajectory& trajectory, bool w_first, const std::string& name);

}  // namespace apvi::io
