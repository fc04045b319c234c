// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <set>
#include <string>
#include <vector>

#include "io/rosbag/bag_recording.hpp"
#include "io/rosbag2/bag_file.hpp"

namespace apvi::io {

using BagFiles = std::vector<std::shared_ptr<const BagFile>>;

/// The messages of all files in order of recording time. A block is open only while its span of
/// time is read. `path` is for messages. Throws InputError when a definition cannot be parsed.
std::unique_ptr<MessageCursor> make_block_cursor(const std::string& path, const BagFiles& files,
                                                 const std::set<std::string>& topics);

}  // namespace apvi::io
