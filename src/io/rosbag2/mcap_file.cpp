// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <atomic>
#include <map>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "io/folder/csv_file.hpp"
#include "io/rosbag2/bag_file.hpp"
#include "io/rosbag2/mcap_index.hpp"

namespace apvi::io {
namespace {

Stamp to_stamp(std::uint64_t ns) {
  return {static_cast<std::int64_t>(std::min(ns, static_cast<std::uint64_t>(kMaxStampNs)))};
}

// The streams that a channel id stands for.
using Streams = std::map<std::uint16_t, const BagStream*>;

class McapBlock : public BagBlock {
 public:
  McapBlock(McapRecords loaded, const Streams& streams) : loaded_(std::move(loaded)) {
    ByteReader reader(loaded_.records);
    while (const auto record = next_record(reader)) {
      if (record->kind != McapKind::message) continue;
      const auto message = parse_message(record->content);
      if (!message) {
        loaded_.complete = false;
        break;
      }
      const auto stream = streams.find(message->channel);
      if (stream == streams.end()) continue;
      messages_.push_back({stream->second, to_stamp(message->log_time), message->data});
    }
    loaded_.complete = loaded_.complete && reader.ok();
    std::stable_sort(messages_.begin(), messages_.end(),
                     [](const auto& a, const auto& b) { return a.recorded < b.recorded; });
  }

  bool next(BagMessage& message) override {
    if (next_ == messages_.size()) return false;
    message = messages_[next_++];
    return true;
  }
  bool damaged() const override { return !loaded_.complete; }
  std::size_t memory() const override {
    return loaded_.storage.capacity() + messages_.capacity() * sizeof(BagMessage);
  }

 private:
  McapRecords loaded_;
  std::vector<BagMessage> messages_;
  std::size_t next_ = 0;
};

// Only messages whose layout a ROS definition describes can be decoded.
BagStream stream_of(const McapChannel& channel, const McapSchema* schema) {
  const McapSchema none;
  const McapSchema& known = schema == nullptr ? none : *schema;
  BagStream stream;
  stream.topic = channel.topic;
  stream.type = ros_type_name(known.name);
  stream.definitions = {known.text};
  const bool ros1 = channel.encoding == "ros1" && known.encoding == "ros1msg";
  const bool ros2 = channel.encoding == "cdr" && known.encoding == "ros2msg";
  stream.wire = ros1 ? RosWire::ros1 : RosWire::cdr;
  if (!ros1 && !ros2) {
    stream.problem =
        fmt::format("encoding \"{}\", schema encoding \"{}\"", channel.encoding, known.encoding);
  }
  return stream;
}

class McapFile : public BagFile {
 public:
  explicit McapFile(const std::filesystem::path& path)
      : file_(path), index_(read_mcap_index(file_)) {
    for (const auto& [id, channel] : index_.channels) {
      const auto schema = index_.schemas.find(channel.schema);
      ids_.push_back(id);
      streams_.push_back(
          stream_of(channel, schema == index_.schemas.end() ? nullptr : &schema->second));
    }
    for (const McapPart& part : index_.parts) {
      blocks_.push_back({to_stamp(part.start), to_stamp(part.end)});
    }
    if (index_.damage) report_damage(*index_.damage);
  }

  const std::vector<BagStream>& streams() const override { return streams_; }
  const std::vector<Span>& blocks() const override { return blocks_; }

  std::unique_ptr<BagBlock> open(std::size_t block,
                                 const std::set<std::string>& topics) const override {
    Streams selected;
    for (std::size_t i = 0; i < ids_.size(); ++i) {
      if (topics.contains(streams_[i].topic)) selected.emplace(ids_[i], &streams_[i]);
    }
    const McapPart& part = index_.parts[block];
    const auto& present = part.channels;
    const bool relevant =
        present.empty() || std::any_of(present.begin(), present.end(),
                                       [&](std::uint16_t id) { return selected.contains(id); });
    if (!relevant) return nullptr;
    auto opened = std::make_unique<McapBlock>(load_part(file_, part), selected);
    if (opened->damaged()) report_damage(part.at);
    return opened;
  }

 private:
  void report_damage(std::uint64_t at) const {
    if (reported_.exchange(true)) return;
    log::warning(
        "{}: damaged at byte {} of {}, or its recording was interrupted; reading what precedes",
        file_.name(), at, file_.size());
  }

  BinaryFile file_;
  McapIndex index_;
  std::vector<std::uint16_t> ids_;  // of the channel of each stream
  std::vector<BagStream> streams_;
  std::vector<Span> blocks_;
  mutable std::atomic<bool> reported_ = false;
};

}  // namespace

std::unique_ptr<BagFile> open_mcap(const std::filesystem::path& path) {
  return std::make_unique<McapFile>(path);
}

}  // namespace apvi::io
