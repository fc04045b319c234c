// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "core/random.hpp"

namespace apvi::test {

/// A csv file as text cells, which faults change.
struct FaultTable {
  std::vector<std::string> header;
  std::vector<std::vector<std::string>> rows;
  char separator = ',';
  std::string line_end = "\n";
  std::string prefix;  ///< before the header, such as a byte order mark

  static FaultTable read(const std::filesystem::path& file);
  void write(const std::filesystem::path& file) const;

  /// Multiplies all numbers of a column.
  void scale(std::size_t column, double factor);
  std::int64_t stamp(std::size_t row) const;
};

/// The tables of a recording.
struct FaultyDive {
  FaultTable imu;
  FaultTable dvl;
  FaultTable depth;
  FaultTable truth;

  /// As a dataset folder, without a rig.
  void write_folder(const std::filesystem::path& folder) const;
  /// As an MCAP file. Rows that are no numbers are messages that nobody published.
  void write_mcap(const std::filesystem::path& file) const;
  /// The same messages as a .db3 file.
  void write_db3(const std::filesystem::path& file) const;
};

/// A fault that people have reported of their recordings.
struct Fault {
  std::string name;
  bool is_harmless = false;  ///< the result must be right without a word
  std::function<void(FaultyDive&, Random&)> apply;
  /// What a message about a wrong result must name, one of these; empty if it is harmless.
  std::vector<std::string> names = {};
};

std::vector<Fault> all_faults();
/// Those that a bag can have, which names neither units nor columns.
std::vector<Fault> bag_faults();

}  // namespace apvi::test
