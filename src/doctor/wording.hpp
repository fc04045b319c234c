// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>

namespace apvi::doctor {

/// "early by 0.10 s", "late by 0.10 s"; "on time (within 0.01 s)" when that rounds to zero.
std::string describe_offset(double seconds, int decimals = 2);
/// "(1.00, 2.00, 3.00)" with each number in the given format.
std::string list(const Eigen::Vector3d& v, const char* format);
/// The rows of a rotation: "[1.000,0.000,0.000; ...]".
std::string rotation_yaml(const Eigen::Matrix3d& r);

}  // namespace apvi::doctor
