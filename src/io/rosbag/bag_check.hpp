// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

namespace apvi::io {

/// Checks that every record length and every index offset of a ROS1 bag (format 2.0) lies inside
/// the file. rosbag_storage does not check them and would read beyond its buffers. Reads lengths
/// and indices only. Throws InputError with the offset of the first violation; files in other
/// formats pass, because rosbag_storage rejects them itself.
void check_bag(const std::filesystem::path& path);

}  // namespace apvi::io
