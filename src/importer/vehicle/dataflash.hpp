// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <istream>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "importer/byte_reader.hpp"

/// The DataFlash format of ArduPilot's logs (.BIN): messages of two magic bytes, a type and fields,
/// little-endian. Messages named FMT describe the fields of each type.
namespace apvi::importer {

struct DataflashField {
  std::string name;
  char type = 0;
  std::size_t offset = 0;  ///< in the message [bytes]
};

struct DataflashFormat {
  std::string name;
  std::size_t size = 0;                ///< of a message with its header [bytes]; 0: not known
  std::vector<DataflashField> fields;  ///< empty if the description contradicts itself
};

class DataflashMessage {
 public:
  DataflashMessage(const DataflashFormat& format, Bytes bytes) : format_(format), bytes_(bytes) {}

  const std::string& name() const { return format_.name; }
  /// A field as a number, with the factor of its type applied (degrees of an `L`); nullopt if there
  /// is no such field, or it is a text.
  std::optional<double> number(std::string_view field) const;
  /// A field as text; empty if there is no such field, or it is a number.
  std::string text(std::string_view field) const;

 private:
  const DataflashField* find(std::string_view field) const;

  const DataflashFormat& format_;
  Bytes bytes_;
};

/// Whether a file begins like a log.
bool is_dataflash(Bytes begin);

/// Calls `visit` for each message with known fields. Returns the number of bytes that belong to no
/// message, without those at the end. Never throws, for any bytes.
std::size_t for_each_dataflash_message(std::istream& in,
                                       const std::function<void(const DataflashMessage&)>& visit);

}  // namespace apvi::importer
