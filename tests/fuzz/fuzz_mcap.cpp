// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/error.hpp"
#include "fuzz/memory_file.hpp"
#include "fuzz/read_bag.hpp"

// An MCAP file, read with all its topics.

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const apvi::fuzz::MemoryFile file(data, size);
  try {
    apvi::fuzz::read_bag(file.path(), apvi::io::open_mcap(file.path()));
  } catch (const apvi::InputError&) {
  }
  return 0;
}
