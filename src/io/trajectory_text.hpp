// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <istream>
#include <string>

#include "apvi/geometry/trajectory.hpp"

namespace apvi::io {

/// The body of `read_trajectory`, from any stream; `name` stands for the file in messages. A file
/// with a header and no poses gives an empty trajectory. Throws InputError as `read_trajectory`
/// does.
Trajectory parse_trajectory(std::istream& in, const std::string& name);

}  // namespace apvi::io
