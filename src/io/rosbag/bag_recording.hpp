// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "io/readers.hpp"
#include "io/rosbag/bag_topics.hpp"
#include "io/rosbag/ros_message.hpp"

namespace apvi::io {

/// A longer message is malformed [bytes]: this fits an image of 20 megapixels.
inline constexpr std::uint64_t kMaxMessage = 64ULL << 20U;

/// Iterates over the messages of selected topics of a bag in recording order.
class MessageCursor {
 public:
  virtual ~MessageCursor() = default;
  /// Advances to the next message; false at the end, or where the bag is damaged.
  virtual bool advance() = 0;
  virtual const std::string& topic() const = 0;
  virtual Stamp recorded() const = 0;
  /// The message, a view into this cursor; nullopt when its bytes do not match its definition.
  virtual std::optional<RosValue> message() const = 0;
  /// Fraction read, in [0, 1].
  virtual double fraction() const = 0;
};

/// A bag of any format.
struct Bag {
  std::string path;
  std::vector<BagTopic> topics;
  std::function<std::unique_ptr<MessageCursor>(const std::set<std::string>& topics)> open;
};

/// The sensors and the reference of a bag, with `own_rig` as its calibration if that exists.
/// Throws InputError when a configured topic does not exist or a sensor of the rig has none.
Recording read_bag(const Bag& bag, const std::filesystem::path& own_rig,
                   const DatasetConfig& config, const SensorChoice& choice);

}  // namespace apvi::io
