// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <cstdlib>
#include <iostream>
#include <string>
#include <vector>

#include "apvi/core/log.hpp"

/// What the fuzz targets share. A target calls one parser with arbitrary bytes: any outcome is
/// right but a crash, a hang, an exception of another kind than InputError (or RunError), or a
/// broken promise.
namespace apvi::fuzz {

/// A promise of the code under test; libFuzzer reports the abort with the input that led to it.
inline void check(bool promise, const char* what) {
  if (promise) return;
  std::cerr << "broken promise: " << what << "\n";
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
