// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

struct sqlite3;
struct sqlite3_stmt;

namespace apvi::io {

/// A sqlite3 file, opened for reading. Not thread-safe.
class Database {
 public:
  /// Throws InputError when the file is no database. A truncated one is opened as well.
  explicit Database(const std::string& path);

  bool truncated() const { return truncated_; }
  /// Of the last error.
  std::string message() const;
  /// Throws InputError with the last error.
  [[noreturn]] void fail() const;

 private:
  friend class Query;
  struct Close {
    void operator()(sqlite3* handle) const;
  };
  std::string path_;
  std::unique_ptr<sqlite3, Close> handle_;
  bool truncated_ = false;
};

/// The rows of a SELECT statement.
class Query {
 public:
  /// Throws InputError when the statement does not fit the database, which must outlive the query.
  Query(const Database& database, const std::string& sql);

  /// True at a row; false at the end, or with `failed`.
  bool step();
  bool failed() const;
  /// For queries that must succeed: throws InputError otherwise.
  bool step_or_fail();
  std::int64_t number(int column) const;
  /// Valid until the next step.
  std::span<const std::uint8_t> bytes(int column) const;
  std::string text(int column) const;

 private:
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const;
  };
  const Database& database_;
  std::unique_ptr<sqlite3_stmt, Finalize> statement_;
  bool failed_ = false;
};

}  // namespace apvi::io
