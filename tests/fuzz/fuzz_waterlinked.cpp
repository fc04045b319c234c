// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>

#include "fuzz/fuzz_target.hpp"
#include "io/folder/waterlinked_report.hpp"
#include "live/line_buffer.hpp"

// What a Water Linked DVL sends, in two parts.

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace apvi;
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  live::LineBuffer lines;
  for (const std::string_view part : {bytes.substr(0, size / 2), bytes.substr(size / 2)}) {
    lines.append(part);
    while (const auto line = lines.next()) {
      const io::WaterLinkedReport report = io::parse_waterlinked(*line);
      fuzz::check(!report.sample || report.sample->stamp.ns > 0, "a sample without a stamp");
      fuzz::check(!report.sample || report.problem.empty(), "a malformed sample");
    }
  }
  return 0;
}
