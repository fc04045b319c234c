// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "importer/byte_reader.hpp"

/// GPMF, the format of GoPro's telemetry: nested items of a four-character key, a type, the size of
/// an element, their number, and the elements, padded to four bytes.
namespace apvi::importer {

struct GpmfItem {
  std::string key;
  char type = 0;                 ///< 0: nested items
  std::size_t element_size = 0;  ///< [bytes]
  std::size_t count = 0;         ///< elements
  Bytes data;
};

/// Calls `visit` for each item until one is damaged or cut off.
void for_each_item(Bytes items, const std::function<void(const GpmfItem&)>& visit);
/// Numbers of an item, element by element; empty for text and other types without numbers.
std::vector<double> numbers_of(const GpmfItem& item);
/// Text of an item without trailing zeros.
std::string text_of(const GpmfItem& item);

/// One stream (STRM) of a payload: samples of a sensor and how to read them.
struct GpmfStream {
  std::string key;                ///< of the data: "ACCL", "GYRO", "SHUT"
  std::size_t channels = 0;       ///< numbers of a sample
  std::vector<double> values;     ///< in `unit`, divided by SCAL; `channels` for each sample
  std::string unit;               ///< SIUN or UNIT, for example "rad/s"; empty if absent
  std::string orientation_in;     ///< ORIN
  std::string orientation_out;    ///< ORIO
  std::vector<double> matrix;     ///< MTRX, row by row
  std::optional<double> stamp_s;  ///< STMP: camera's clock at the first sample [s]

  std::size_t size() const { return channels == 0 ? 0 : values.size() / channels; }
};

/// A payload: about one second of all streams.
struct GpmfPayload {
  std::string device;  ///< DVNM: "HERO10 Black"
  std::vector<GpmfStream> streams;

  const GpmfStream* find(const std::string& key) const;
};
GpmfPayload parse_gpmf(Bytes payload);

/// The camera's settings that decide on the angle of view, from a file's `udta`.
struct GpmfSettings {
  std::string field_of_view;  ///< VFOV: "W" wide, "L" linear, "N" narrow, "S" SuperView …
  std::optional<double> diagonal_deg;  ///< ZFOV: of the image in air
  std::string device;                  ///< MINF: "HERO10 Black"
};
GpmfSettings parse_gpmf_settings(Bytes items);

}  // namespace apvi::importer
