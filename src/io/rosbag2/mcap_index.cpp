// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag2/mcap_index.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "apvi/core/error.hpp"

namespace apvi::io {
namespace {

constexpr std::uint64_t kMaxIndexRecord = 16ULL << 20U;  // bytes of a schema, a channel, …
constexpr std::uint64_t kMaxRun = 4ULL << 20U;  // bytes of messages outside chunks in one part
constexpr std::uint64_t kMessageHeader = 22;
constexpr std::uint64_t kFooter = 20;

struct Place {
  McapKind kind{};
  std::uint64_t content = 0;  // position
  std::uint64_t length = 0;   // may exceed the file
  std::uint64_t end() const { return content + length; }
};

std::optional<Place> place_at(BinaryFile& file, std::uint64_t at) {
  std::array<std::uint8_t, kMcapRecordPrefix> prefix{};
  if (!file.read(at, prefix)) return std::nullopt;
  ByteReader reader(prefix);
  Place place;
  place.kind = static_cast<McapKind>(reader.number<std::uint8_t>());
  place.length = reader.number<std::uint64_t>();
  place.content = at + kMcapRecordPrefix;
  return place;
}

bool fits(const BinaryFile& file, const Place& place) {
  return place.length <= file.size() - place.content;
}

// Adds a schema or a channel; false when the record is damaged.
bool add_definition(McapIndex& index, McapKind kind, Bytes content) {
  if (kind == McapKind::schema) {
    auto schema = parse_schema(content);
    if (schema) index.schemas.try_emplace(schema->id, std::move(*schema));
    return schema.has_value();
  }
  if (kind == McapKind::channel) {
    auto channel = parse_channel(content);
    if (channel) index.channels.try_emplace(channel->id, std::move(*channel));
    return channel.has_value();
  }
  return true;
}

// Reads the index at the end of a complete file.
class Summary {
 public:
  explicit Summary(BinaryFile& file) : file_(file) {}

  std::optional<McapIndex> read() {
    const auto start = find_start();
    if (!start) return std::nullopt;
    for (std::uint64_t at = *start; at < footer_;) {
      const auto place = place_at(file_, at);
      if (!place || !fits(file_, *place) || place->end() > footer_ || !add(*place)) {
        return std::nullopt;
      }
      at = place->end();
    }
    return is_sufficient() ? std::optional(std::move(index_)) : std::nullopt;
  }

 private:
  std::optional<std::uint64_t> find_start() {
    const std::uint64_t tail = kMcapRecordPrefix + kFooter + kMcapMagic.size();
    if (file_.size() < kMcapMagic.size() + tail) return std::nullopt;
    footer_ = file_.size() - tail;
    const auto place = place_at(file_, footer_);
    std::array<std::uint8_t, kFooter> content{};
    if (!place || place->kind != McapKind::footer || place->length != kFooter ||
        !file_.read(place->content, content)) {
      return std::nullopt;
    }
    const auto start = ByteReader(content).number<std::uint64_t>();
    return start >= kMcapMagic.size() && start < footer_ ? std::optional(start) : std::nullopt;
  }

  bool add(const Place& place) {
    const bool used = place.kind == McapKind::schema || place.kind == McapKind::channel ||
                      place.kind == McapKind::chunk_index || place.kind == McapKind::statistics;
    if (!used) return true;
    if (place.length > kMaxIndexRecord) return false;
    const auto content = file_.read_block(place.content, place.length);
    if (place.kind == McapKind::statistics)
      return (statistics_ = parse_statistics(content)) != std::nullopt;
    if (place.kind == McapKind::chunk_index) return add_chunk(content);
    return add_definition(index_, place.kind, content);
  }

  bool add_chunk(Bytes content) {
    auto chunk = parse_chunk_index(content);
    if (!chunk || chunk->at > footer_ || chunk->length < kMcapRecordPrefix ||
        chunk->length > footer_ - chunk->at) {
      return false;
    }
    McapPart part;
    part.start = chunk->start;
    part.end = chunk->end;
    part.at = chunk->at + kMcapRecordPrefix;
    part.length = chunk->length - kMcapRecordPrefix;
    part.channels = std::move(chunk->channels);
    index_.parts.push_back(std::move(part));
    return true;
  }

  // Parts of the summary are optional: it may lack channels, or messages outside chunks.
  bool is_sufficient() const {
    if (index_.channels.empty() || index_.parts.empty()) return false;
    return !statistics_ || (statistics_->channels == index_.channels.size() &&
                            statistics_->chunks == index_.parts.size());
  }

  BinaryFile& file_;
  std::uint64_t footer_ = 0;
  McapIndex index_;
  std::optional<McapStatistics> statistics_;
};

// Reads a file from its beginning, up to its end or the damage.
class Scan {
 public:
  explicit Scan(BinaryFile& file) : file_(file) {}

  McapIndex read() {
    std::uint64_t at = kMcapMagic.size();
    while (true) {
      const auto place = place_at(file_, at);
      if (place && (place->kind == McapKind::data_end || place->kind == McapKind::footer)) break;
      if (!place || !add(at, *place)) {
        index_.damage = at;
        break;
      }
      at = place->end();
    }
    return std::move(index_);
  }

 private:
  bool add(std::uint64_t at, const Place& place) {
    if (place.kind == McapKind::chunk) return add_chunk(place);
    if (!fits(file_, place) || place.kind == McapKind{}) return false;
    if (place.kind == McapKind::message) return add_message(at, place);
    if (place.kind != McapKind::schema && place.kind != McapKind::channel) return true;
    if (place.length > kMaxIndexRecord) return false;
    return add_definition(index_, place.kind, file_.read_block(place.content, place.length));
  }

  // The last chunk of a truncated file is used as far as it exists.
  bool add_chunk(const Place& place) {
    McapPart part;
    part.at = place.content;
    part.length = std::min(place.length, file_.size() - place.content);
    const McapRecords loaded = load_part(file_, part);
    part.start = UINT64_MAX;
    const bool intact = add_records(loaded.records, part) && loaded.complete && fits(file_, place);
    if (part.start <= part.end) index_.parts.push_back(std::move(part));
    return intact;
  }

  bool add_records(Bytes records, McapPart& part) {
    ByteReader reader(records);
    while (const auto record = next_record(reader)) {
      if (!add_definition(index_, record->kind, record->content)) return false;
      if (record->kind != McapKind::message) continue;
      const auto message = parse_message(record->content);
      if (!message) return false;
      extend(part, message->log_time);
    }
    return reader.ok();
  }

  bool add_message(std::uint64_t at, const Place& place) {
    std::array<std::uint8_t, kMessageHeader> header{};
    if (place.length < kMessageHeader || !file_.read(place.content, header)) return false;
    const auto message = parse_message(header);
    const bool continues = !index_.parts.empty() && !index_.parts.back().chunk &&
                           place.end() - index_.parts.back().at <= kMaxRun;
    if (!continues) {
      index_.parts.push_back({message->log_time, message->log_time, at, 0, false, {}});
    }
    McapPart& part = index_.parts.back();
    extend(part, message->log_time);
    part.length = place.end() - part.at;
    return true;
  }

  static void extend(McapPart& part, std::uint64_t time) {
    part.start = std::min(part.start, time);
    part.end = std::max(part.end, time);
  }

  BinaryFile& file_;
  McapIndex index_;
};

}  // namespace

McapIndex read_mcap_index(BinaryFile& file) {
  std::array<std::uint8_t, kMcapMagic.size()> magic{};
  const bool readable = file.read(0, magic);
  if (!readable ||
      !std::equal(magic.begin(), magic.end(), kMcapMagic.begin(),
                  [](std::uint8_t a, char b) { return a == static_cast<std::uint8_t>(b); })) {
    fail_input("{}: this is no MCAP file, or it is empty", file.name());
  }
  if (auto index = Summary(file).read()) return std::move(*index);
  return Scan(file).read();
}

}  // namespace apvi::io
