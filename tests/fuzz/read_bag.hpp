// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <set>
#include <string>

#include "fuzz/fuzz_target.hpp"
#include "io/rosbag/dvl_message.hpp"
#include "io/rosbag/ros_samples.hpp"
#include "io/rosbag2/block_cursor.hpp"

namespace apvi::fuzz {

/// Reads all topics of a bag to its end.
inline void read_bag(const std::string& path, std::unique_ptr<io::BagFile> file) {
  io::BagFiles files;
  files.push_back(std::move(file));
  std::set<std::string> topics;
  for (const io::BagStream& stream : files[0]->streams()) topics.insert(stream.topic);
  const auto cursor = io::make_block_cursor(path, files, topics);
  while (cursor->advance()) {
    check(topics.contains(cursor->topic()), "a topic was not asked for");
    check(cursor->fraction() >= 0.0 && cursor->fraction() <= 1.0, "progress is not in [0, 1]");
    const auto message = cursor->message();
    if (!message) continue;
    io::imu_of(*message, cursor->recorded());
    io::dvl_of(*message, cursor->recorded());
    io::image_of(0, "fuzz")(*message, cursor->recorded());
  }
  check(cursor->fraction() == 1.0, "progress at the end is not 1");
}

}  // namespace apvi::fuzz
