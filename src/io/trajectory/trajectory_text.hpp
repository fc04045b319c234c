// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <istream>
#include <string>

#include "apvi/geometry/trajectory.hpp"
#include "apvi/io/tum.hpp"

namespace apvi::io {

/// Parses a trajectory from any stream, as `read_trajectory`; `name` is the file name for messages.
/// A file with a header and no poses gives an empty trajectory. Throws InputError as
/// `read_trajectory`.
Trajectory parse_trajectory(std::istream& in, const std::string& name,
                            BadLines bad_lines = BadLines::fail);

}  // namespace apvi::io
