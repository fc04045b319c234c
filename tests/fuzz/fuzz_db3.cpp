// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/error.hpp"
#include "fuzz/memory_file.hpp"
#include "fuzz/read_bag.hpp"

// A .db3 file of ROS 2, read with all its topics.

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const apvi::fuzz::MemoryFile file(data, size);
  try {
    apvi::fuzz::read_bag(file.path(), apvi::io::open_sqlite(file.path()));
  } catch (const apvi::InputError&) {
  }
  return 0;
}
