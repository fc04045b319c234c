// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

#include "apvi/core/log.hpp"

/// Shared code of the fuzz targets. A target calls one parser with arbitrary bytes and must not
/// crash, hang, throw anything but InputError (or RunError), or violate a checked condition.
namespace apvi::fuzz {

/// Checks a condition of the code under test; libFuzzer reports the abort with the input.
inline void check(bool condition, const char* what) {
  if (condition) return;
  std::cerr << "check failed: " << what << "\n";
  std::abort();
}

/// The parts between NUL bytes.
inline std::vector<std::string> split(const std::uint8_t* data, std::size_t size) {
  std::vector<std::string> parts(1);
  for (std::size_t i = 0; i < size; ++i) {
    if (data[i] == 0) {
      parts.emplace_back();
    } else {
      parts.back().push_back(static_cast<char>(data[i]));
    }
  }
  return parts;
}

}  // namespace apvi::fuzz

extern "C" inline int LLVMFuzzerInitialize(int*, char***) {
  apvi::log::set_console_level(apvi::log::Level::error);
  return 0;
}
