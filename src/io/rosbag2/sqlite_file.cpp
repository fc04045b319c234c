// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/ranges.h>

#include <algorithm>
#include <atomic>
#include <map>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "io/folder/csv_file.hpp"
#include "io/rosbag/bag_recording.hpp"
#include "io/rosbag2/bag_file.hpp"
#include "io/rosbag2/database.hpp"

namespace apvi::io {
namespace {

Stamp to_stamp(std::int64_t ns) {
  return {std::clamp<std::int64_t>(ns, 0, kMaxStampNs)};
}

bool has_table(const Database& database, const std::string& name) {
  Query query(database, "SELECT 1 FROM sqlite_master WHERE type='table' AND name='" + name + "'");
  return query.step_or_fail();
}

// Sorting by time without an index would copy all messages first. A truncated file often lacks
// pages of the index.
std::string order_of(const Database& database) {
  if (database.truncated()) return "id";
  Query query(database,
              "SELECT 1 FROM sqlite_master WHERE type='index' AND tbl_name='messages' AND "
              "sql LIKE '%(timestamp%'");
  return query.step_or_fail() ? "timestamp, id" : "id";
}

// All messages of a file. A longer message than allowed is not loaded: its bytes are empty.
class SqliteBlock : public BagBlock {
 public:
  SqliteBlock(const std::string& path, std::map<std::int64_t, const BagStream*> streams,
              std::function<void(const std::string&)> report)
      : database_(path),
        streams_(std::move(streams)),
        report_(std::move(report)),
        query_(database_, sql()) {}

  bool next(BagMessage& message) override {
    if (!query_.step()) {
      if (query_.failed()) report_(database_.message());
      return false;
    }
    message = {streams_.at(query_.number(0)), to_stamp(query_.number(1)), query_.bytes(2)};
    return true;
  }
  bool damaged() const override { return query_.failed(); }
  std::size_t memory() const override { return 0; }

 private:
  std::string sql() const {
    std::vector<std::int64_t> ids;
    for (const auto& [id, stream] : streams_) ids.push_back(id);
    return fmt::format(
        "SELECT topic_id, timestamp, CASE WHEN length(data) <= {} THEN data END FROM messages "
        "{} WHERE topic_id IN ({}) ORDER BY {}",
        kMaxMessage, database_.truncated() ? "NOT INDEXED" : "", fmt::join(ids, ", "),
        order_of(database_));
  }

  Database database_;
  std::map<std::int64_t, const BagStream*> streams_;  // by the id of the topic
  std::function<void(const std::string&)> report_;
  Query query_;
};

class SqliteFile : public BagFile {
 public:
  SqliteFile(const std::filesystem::path& path, const MessageFolder& known) : path_(path.string()) {
    const Database database(path_);
    if (!has_table(database, "topics") || !has_table(database, "messages")) {
      fail_input("{}: this sqlite3 file is no ROS 2 bag: it lacks the tables topics and messages",
                 path_);
    }
    read_streams(database, known);
    if (database.truncated()) report_damage("it is truncated");
    read_span(database);
  }

  const std::vector<BagStream>& streams() const override { return streams_; }
  const std::vector<Span>& blocks() const override { return blocks_; }

  std::unique_ptr<BagBlock> open(std::size_t, const std::set<std::string>& topics) const override {
    std::map<std::int64_t, const BagStream*> selected;
    for (std::size_t i = 0; i < ids_.size(); ++i) {
      if (topics.contains(streams_[i].topic)) selected.emplace(ids_[i], &streams_[i]);
    }
    if (selected.empty()) return nullptr;
    return std::make_unique<SqliteBlock>(path_, std::move(selected),
                                         [this](const std::string& what) { report_damage(what); });
  }

 private:
  // With one aggregate per query sqlite3 uses the index.
  void read_span(const Database& database) {
    Query range(database, database.truncated()
                              ? "SELECT timestamp, timestamp FROM messages NOT INDEXED LIMIT 1"
                              : "SELECT (SELECT min(timestamp) FROM messages), "
                                "(SELECT max(timestamp) FROM messages)");
    if (range.step_or_fail()) blocks_ = {{to_stamp(range.number(0)), to_stamp(range.number(1))}};
  }

  void read_streams(const Database& database, const MessageFolder& known) {
    const auto definitions = definitions_of(database);
    Query topics(database, "SELECT id, name, type, serialization_format FROM topics");
    while (topics.step_or_fail()) {
      BagStream stream;
      stream.topic = topics.text(1);
      stream.type = ros_type_name(topics.text(2));
      const std::string format = topics.text(3);
      const auto own = definitions.find(stream.type);
      stream.definitions =
          own == definitions.end() ? known.definitions(stream.type) : std::vector{own->second};
      if (format != "cdr") {
        stream.problem = fmt::format("encoding \"{}\"", format);
      } else if (stream.definitions.empty()) {
        stream.problem = fmt::format("no definition of {} in the bag", stream.type);
      }
      ids_.push_back(topics.number(0));
      streams_.push_back(std::move(stream));
    }
  }

  // Bags since ROS 2 Iron contain the definitions.
  static std::map<std::string, std::string> definitions_of(const Database& database) {
    std::map<std::string, std::string> found;
    if (!has_table(database, "message_definitions")) return found;
    Query query(database,
                "SELECT topic_type, encoded_message_definition FROM message_definitions "
                "WHERE encoding = 'ros2msg'");
    while (query.step_or_fail()) {
      if (std::string text = query.text(1); !text.empty()) {
        found[ros_type_name(query.text(0))] = std::move(text);
      }
    }
    return found;
  }

  void report_damage(const std::string& what) const {
    if (reported_.exchange(true)) return;
    log::warning("{}: the bag is damaged: {}; reading what precedes", path_, what);
  }

  std::string path_;
  std::vector<std::int64_t> ids_;  // of the topic of each stream
  std::vector<BagStream> streams_;
  std::vector<Span> blocks_;
  mutable std::atomic<bool> reported_ = false;
};

}  // namespace

std::unique_ptr<BagFile> open_sqlite(const std::filesystem::path& path,
                                     const MessageFolder& definitions) {
  return std::make_unique<SqliteFile>(path, definitions);
}

}  // namespace apvi::io
