// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "apvi/io/sequence.hpp"

namespace apvi::io {

/// A topic of a bag.
struct BagTopic {
  std::string name;
  std::string type;
  std::string definition;
};

/// The topic of each sensor; an empty name means that the bag has none.
struct ChosenTopics {
  std::string imu;
  std::string dvl;
  std::string pressure;
  std::string depth;
  std::string cam0;
  std::string cam1;
  std::string reference;
};

/// Chooses by configuration, else by message type and usual names (in any case of letters). Says in
/// the log what it took, and warns where several would do. `bag` stands for the file in messages.
/// Throws InputError when a configured topic is not in the bag.
ChosenTopics choose_topics(const std::vector<BagTopic>& topics, const TopicConfig& config,
                           const std::string& bag);

}  // namespace apvi::io
