// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "io/rosbag/ros_message.hpp"
#include "io/rosbag2/message_folder.hpp"

namespace apvi::io {

/// The messages of one topic in one file.
struct BagStream {
  std::string topic;
  std::string type;  ///< "sensor_msgs/Imu"
  RosWire wire = RosWire::cdr;
  std::vector<std::string> definitions;  ///< alternatives, if the bag does not contain it
  std::string problem;                   ///< why it cannot be read; empty: it can
};

/// A message as recorded; its bytes are valid until the next one is read.
struct BagMessage {
  const BagStream* stream = nullptr;
  Stamp recorded;
  std::span<const std::uint8_t> bytes;
};

/// Messages of selected topics in order of recording time.
class BagBlock {
 public:
  virtual ~BagBlock() = default;
  /// False at the end, or where the block is damaged.
  virtual bool next(BagMessage& message) = 0;
  /// Whether the file is damaged in this block. Final after `next` returned false.
  virtual bool damaged() const = 0;
  /// Memory in use [bytes].
  virtual std::size_t memory() const = 0;
};

/// One file of a ROS 2 bag: blocks of messages, which may overlap in time.
class BagFile {
 public:
  struct Span {
    Stamp start;  ///< recording times of its messages
    Stamp end;
  };

  virtual ~BagFile() = default;
  virtual const std::vector<BagStream>& streams() const = 0;
  virtual const std::vector<Span>& blocks() const = 0;
  /// Null when the block has no message of these topics.
  virtual std::unique_ptr<BagBlock> open(std::size_t block,
                                         const std::set<std::string>& topics) const = 0;
};

/// Both throw InputError when the file cannot be read at all. Files with damage are read up to it,
/// with one warning.
std::unique_ptr<BagFile> open_mcap(const std::filesystem::path& path);
std::unique_ptr<BagFile> open_sqlite(const std::filesystem::path& path,
                                     const MessageFolder& definitions = {});

}  // namespace apvi::io
