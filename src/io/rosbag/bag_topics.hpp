// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "apvi/io/sequence.hpp"

namespace apvi::io {

/// A topic of a bag. The type has no "msg/" in it: "sensor_msgs/Imu".
struct BagTopic {
  std::string name;
  std::string type;
  std::string definition;
};

/// The topic of each sensor; empty if the bag has none.
struct ChosenTopics {
  std::string imu;
  std::string dvl;
  std::string pressure;
  std::string depth;
  std::string cam0;
  std::string cam1;
  std::string reference;
};

/// Chooses topics by configuration, else by message type and common names (case-insensitive). Logs
/// the choice, with a warning when it is ambiguous. `bag` is the file name for messages. Throws
/// InputError when a configured topic is not in the bag.
ChosenTopics choose_topics(const std::vector<BagTopic>& topics, const TopicConfig& config,
                           const std::string& bag);

}  // namespace apvi::io
