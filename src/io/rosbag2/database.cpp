// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag2/database.hpp"

#include <sqlite3.h>

#include "apvi/core/error.hpp"

namespace apvi::io {
namespace {

int execute(sqlite3* handle, const char* sql) {
  return sqlite3_exec(handle, sql, nullptr, nullptr, nullptr);
}

}  // namespace

Database::Database(const std::string& path) : path_(path) {
  sqlite3* opened = nullptr;
  const int status = sqlite3_open_v2(path.c_str(), &opened, SQLITE_OPEN_READONLY, nullptr);
  handle_.reset(opened);
  if (status != SQLITE_OK) fail();
  // The schema of a file from elsewhere must not run code.
  sqlite3_db_config(opened, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  constexpr const char* kProbe = "SELECT count(*) FROM sqlite_master";
  if (execute(opened, kProbe) == SQLITE_CORRUPT) {
    // sqlite3 refuses files with missing pages, except in this mode for repairs.
    execute(opened, "PRAGMA writable_schema=ON");
    truncated_ = true;
  }
  if (execute(opened, kProbe) != SQLITE_OK) fail();
}

std::string Database::message() const {
  return sqlite3_errmsg(handle_.get());
}

void Database::fail() const {
  fail_input("{}: cannot read this ROS 2 bag: {}; check that it is a complete sqlite3 file", path_,
             message());
}

void Database::Close::operator()(sqlite3* handle) const {
  sqlite3_close(handle);
}

Query::Query(const Database& database, const std::string& sql) : database_(database) {
  sqlite3_stmt* prepared = nullptr;
  const int status =
      sqlite3_prepare_v2(database.handle_.get(), sql.c_str(), -1, &prepared, nullptr);
  statement_.reset(prepared);
  if (status != SQLITE_OK) database.fail();
}

bool Query::step() {
  const int status = sqlite3_step(statement_.get());
  failed_ = status != SQLITE_ROW && status != SQLITE_DONE;
  return status == SQLITE_ROW;
}

bool Query::failed() const {
  return failed_;
}

bool Query::step_or_fail() {
  const bool row = step();
  if (failed()) database_.fail();
  return row;
}

std::int64_t Query::number(int column) const {
  return sqlite3_column_int64(statement_.get(), column);
}

std::span<const std::uint8_t> Query::bytes(int column) const {
  const void* data = sqlite3_column_blob(statement_.get(), column);
  const int size = sqlite3_column_bytes(statement_.get(), column);
  if (data == nullptr) return {};
  return {static_cast<const std::uint8_t*>(data), static_cast<std::size_t>(size)};
}

std::string Query::text(int column) const {
  const auto content = bytes(column);
  return {reinterpret_cast<const char*>(content.data()), content.size()};
}

void Query::Finalize::operator()(sqlite3_stmt* statement) const {
  sqlite3_finalize(statement);
}

}  // namespace apvi::io
