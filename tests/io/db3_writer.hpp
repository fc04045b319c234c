// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace apvi::test {

/// Writes .db3 files with the tables of rosbag2.
class Db3Writer {
 public:
  explicit Db3Writer(const std::filesystem::path& path) {
    sqlite3* opened = nullptr;
    sqlite3_open(path.c_str(), &opened);
    handle_.reset(opened);
    execute("PRAGMA page_size=512; PRAGMA journal_mode=OFF; PRAGMA synchronous=OFF; BEGIN");
    execute(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
        "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)");
    execute(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
        "timestamp INTEGER NOT NULL, data BLOB NOT NULL)");
    execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)");
  }

  /// Adds a topic, with its definition as bags since ROS 2 Iron have it, unless it is empty.
  int add_topic(const std::string& topic, const std::string& type,
                const std::string& definition = "", const std::string& format = "cdr") {
    insert(
        "INSERT INTO topics(name, type, serialization_format, offered_qos_profiles) "
        "VALUES(?, ?, ?, '')",
        {topic, type, format});
    if (!definition.empty()) {
      execute(
          "CREATE TABLE IF NOT EXISTS message_definitions(id INTEGER PRIMARY KEY, "
          "topic_type TEXT, encoding TEXT, encoded_message_definition TEXT)");
      insert(
          "INSERT INTO message_definitions(topic_type, encoding, encoded_message_definition) "
          "VALUES(?, 'ros2msg', ?)",
          {type, definition});
    }
    return ++topics_;
  }

  void write(int topic, std::int64_t ns, const std::vector<std::uint8_t>& message) {
    const auto statement = prepare("INSERT INTO messages(topic_id, timestamp, data) VALUES(?,?,?)");
    sqlite3_bind_int(statement.get(), 1, topic);
    sqlite3_bind_int64(statement.get(), 2, ns);
    sqlite3_bind_blob(statement.get(), 3, message.data(), static_cast<int>(message.size()),
                      SQLITE_TRANSIENT);
    sqlite3_step(statement.get());
  }
  void close() {
    execute("COMMIT");
    handle_.reset();
  }

 private:
  struct Close {
    void operator()(sqlite3* handle) const { sqlite3_close(handle); }
    void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
  };
  void execute(const char* sql) {
    if (sqlite3_exec(handle_.get(), sql, nullptr, nullptr, nullptr) != SQLITE_OK) {
      throw std::runtime_error(sqlite3_errmsg(handle_.get()));
    }
  }
  std::unique_ptr<sqlite3_stmt, Close> prepare(const char* sql) {
    sqlite3_stmt* statement = nullptr;
    sqlite3_prepare_v2(handle_.get(), sql, -1, &statement, nullptr);
    return std::unique_ptr<sqlite3_stmt, Close>(statement);
  }
  void insert(const char* sql, const std::vector<std::string>& values) {
    const auto statement = prepare(sql);
    int i = 0;
    for (const std::string& value : values) {
      sqlite3_bind_text(statement.get(), ++i, value.c_str(), -1, SQLITE_TRANSIENT);
    }
    sqlite3_step(statement.get());
  }

  std::unique_ptr<sqlite3, Close> handle_;
  int topics_ = 0;
};

}  // namespace apvi::test
