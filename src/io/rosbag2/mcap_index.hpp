// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "io/rosbag2/binary_file.hpp"
#include "io/rosbag2/mcap_records.hpp"

namespace apvi::io {

/// Neighboring messages that are loaded together.
struct McapPart {
  std::uint64_t start = 0;  ///< smallest log time [ns]
  std::uint64_t end = 0;    ///< largest log time [ns]
  std::uint64_t at = 0;     ///< position in the file: the content of a chunk, or the first record
  std::uint64_t length = 0;
  bool chunk = true;                    ///< false: records outside any chunk
  std::vector<std::uint16_t> channels;  ///< with messages in it; empty: unknown
};

/// What an MCAP file contains, and where.
struct McapIndex {
  std::map<std::uint16_t, McapSchema> schemas;
  std::map<std::uint16_t, McapChannel> channels;
  std::vector<McapPart> parts;          ///< in the order of the file
  std::optional<std::uint64_t> damage;  ///< position where the file is damaged or ends early
};

/// The index from the file's summary, or from reading the entire file when it has no complete one.
/// Throws InputError when the file is no MCAP file.
McapIndex read_mcap_index(BinaryFile& file);

/// The records of a part. `complete` is false when some are missing because of damage.
struct McapRecords {
  std::vector<std::uint8_t> storage;
  Bytes records;  ///< a view into `storage`
  bool complete = false;
};
McapRecords load_part(const BinaryFile& file, const McapPart& part);

}  // namespace apvi::io
