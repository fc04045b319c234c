// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/error.hpp"
#include "formats.hpp"

namespace apvi::sim {

void write_bag(const std::filesystem::path& root, const Scene&, const Recording&) {
  fail_input("{}: this build writes no ROS bags; choose another --format", root.string());
}

}  // namespace apvi::sim
