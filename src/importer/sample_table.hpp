// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <initializer_list>
#include <optional>
#include <string>
#include <vector>

#include "importer/byte_reader.hpp"

namespace apvi::importer {

struct BoxHeader {
  std::string type;
  std::uint64_t total = 0;  ///< with its header [bytes]; 0 when the header is damaged
  std::uint64_t header = 0;
};
/// `head` holds the first bytes of a box, `left` is the number of bytes to the end of what contains
/// it. A box that claims to be larger than that ends there.
BoxHeader read_box_header(Bytes head, std::uint64_t left);

/// Calls `visit` with the type and content of each box.
void for_each_box(Bytes boxes, const std::function<void(const std::string&, Bytes)>& visit);
/// Content of the first box along a path of types.
std::optional<Bytes> find_box(Bytes boxes, std::initializer_list<const char*> path);

/// A sample of a track, in ticks of the track's clock.
struct TableSample {
  std::uint64_t offset = 0;
  std::uint32_t size = 0;
  std::int64_t time = 0;  ///< of presentation, without the edit list
  std::uint32_t duration = 0;
};
/// Joins the tables of an `stbl` box: stsz, stsc, stco or co64, stts, ctts. Throws InputError,
/// beginning with `name`, when they contradict each other.
std::vector<TableSample> read_sample_table(Bytes stbl, const std::string& name);

}  // namespace apvi::importer
