// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>

namespace apvi::map_io {

/// Local origin of a map in the coordinates of the recording's poses [m]: what to add to the
/// positions of the Gaussians, which are float32 and would lose precision far from zero. It is zero
/// for maps near zero.
using Origin = std::array<double, 3>;

bool is_zero(const Origin& origin);

}  // namespace apvi::map_io
