// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

namespace apvi::io {

/// Walks through the records of a ROS1 bag (format 2.0) and checks that every length and every
/// place that its index names lies inside the file. rosbag_storage believes both, and would read
/// beyond its buffers. Reads lengths and indices only. Throws InputError with the place of what
/// does not fit; files that are no bag of this format pass: rosbag_storage refuses them itself.
void check_bag(const std::filesystem::path& path);

}  // namespace apvi::io
