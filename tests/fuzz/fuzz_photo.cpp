// SPDX-License-Identifier: BSD-3-Clause
#include "fuzz/fuzz_target.hpp"
#include "importer/photo_header.hpp"

// The header of a photograph.

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace apvi;
  const auto header = importer::parse_photo_header({data, size});
  if (header) fuzz::check(header->size.width > 0 && header->size.height > 0, "no size");
  return 0;
}
