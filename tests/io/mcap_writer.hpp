// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <lz4frame.h>
#include <zstd.h>

#include <cstdint>
#include <cstring>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "io/rosbag2/mcap_records.hpp"

namespace apvi::test {

/// Builds MCAP files in memory, of any structure that the format allows.
class McapWriter {
 public:
  struct Options {
    std::string compression = {};  ///< "", "lz4" or "zstd"
    bool chunks = true;            ///< false: messages outside chunks
    bool summary = true;           ///< the index at the end
    bool with_crc = true;
  };

  McapWriter() : McapWriter(Options{}) {}
  explicit McapWriter(Options options) : options_(std::move(options)), file_(io::kMcapMagic) {
    file_ += record(io::McapKind::header, text("ros2") + text("test"));
  }

  /// Adds a topic and returns the id of its channel, which is also that of its schema.
  std::uint16_t add_topic(const std::string& topic, const std::string& type,
                          const std::string& definition, const std::string& encoding = "cdr",
                          const std::string& schema_encoding = "ros2msg") {
    const auto id = static_cast<std::uint16_t>(++topics_);
    std::string schema = number(id) + text(type) + text(schema_encoding) + text(definition);
    definitions_[id] = record(io::McapKind::schema, schema) +
                       record(io::McapKind::channel,
                              number(id) + number(id) + text(topic) + text(encoding) + number(0U));
    return id;
  }

  void write(std::uint16_t channel, std::int64_t log_ns, const std::vector<std::uint8_t>& message) {
    if (written_.insert(channel).second) open_ += definitions_.at(channel);
    const auto time = static_cast<std::uint64_t>(log_ns);
    open_ +=
        record(io::McapKind::message, number(channel) + number(0U) + number(time) + number(time) +
                                          std::string(message.begin(), message.end()));
    start_ = std::min(start_, time);
    end_ = std::max(end_, time);
    present_.insert(channel);
  }

  /// Ends the chunk of the messages written since the last call.
  void end_chunk() {
    if (open_.empty()) return;
    const std::string stored = options_.chunks ? chunk() : open_;
    if (options_.chunks) index_.push_back(chunk_index(file_.size(), stored.size()));
    file_ += stored;
    open_.clear();
    present_.clear();
    start_ = UINT64_MAX;
    end_ = 0;
  }

  /// The file.
  std::string finish() {
    end_chunk();
    file_ += record(io::McapKind::data_end, number(0U));
    const std::uint64_t summary = options_.summary ? file_.size() : 0;
    if (options_.summary) {
      for (const auto& [id, definition] : definitions_) file_ += definition;
      for (const std::string& index : index_) file_ += index;
      file_ += statistics();
    }
    file_ += record(io::McapKind::footer, number(summary) + number(std::uint64_t{0}) + number(0U));
    return file_ + std::string(io::kMcapMagic);
  }

 private:
  template <typename T>
  static std::string number(T value) {
    std::string bytes(sizeof(T), '\0');
    std::memcpy(bytes.data(), &value, sizeof(T));
    return bytes;
  }
  static std::string text(const std::string& text) {
    return number(static_cast<std::uint32_t>(text.size())) + text;
  }
  static std::string record(io::McapKind kind, const std::string& content) {
    return std::string(1, static_cast<char>(kind)) +
           number(static_cast<std::uint64_t>(content.size())) + content;
  }

  std::string compressed() const {
    std::string out = open_;
    if (options_.compression == "lz4") {
      out.resize(LZ4F_compressFrameBound(open_.size(), nullptr));
      out.resize(LZ4F_compressFrame(out.data(), out.size(), open_.data(), open_.size(), nullptr));
    } else if (options_.compression == "zstd") {
      out.resize(ZSTD_compressBound(open_.size()));
      out.resize(ZSTD_compress(out.data(), out.size(), open_.data(), open_.size(), 1));
    }
    return out;
  }
  std::string chunk() const {
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(open_.data());
    const std::uint32_t crc = options_.with_crc ? io::crc32({bytes, open_.size()}) : 0;
    const std::string stored = compressed();
    return record(io::McapKind::chunk,
                  number(start_) + number(end_) + number(static_cast<std::uint64_t>(open_.size())) +
                      number(crc) + text(options_.compression) +
                      number(static_cast<std::uint64_t>(stored.size())) + stored);
  }
  std::string chunk_index(std::uint64_t at, std::uint64_t length) const {
    std::string offsets;
    for (const std::uint16_t id : present_) offsets += number(id) + number(std::uint64_t{0});
    return record(io::McapKind::chunk_index,
                  number(start_) + number(end_) + number(at) + number(length) + text(offsets) +
                      number(std::uint64_t{0}) + text(options_.compression) +
                      number(std::uint64_t{0}) + number(std::uint64_t{0}));
  }
  std::string statistics() const {
    return record(io::McapKind::statistics,
                  number(std::uint64_t{0}) + number(static_cast<std::uint16_t>(topics_)) +
                      number(static_cast<std::uint32_t>(topics_)) + number(0U) + number(0U) +
                      number(static_cast<std::uint32_t>(index_.size())) + number(std::uint64_t{0}) +
                      number(std::uint64_t{0}) + text(""));
  }

  Options options_;
  std::string file_;
  int topics_ = 0;
  std::map<std::uint16_t, std::string> definitions_;  // records of schema and channel
  std::set<std::uint16_t> written_;
  std::string open_;  // records of the chunk
  std::set<std::uint16_t> present_;
  std::uint64_t start_ = UINT64_MAX;
  std::uint64_t end_ = 0;
  std::vector<std::string> index_;
};

}  // namespace apvi::test
