// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "support/tmp_dir.hpp"

namespace apvi::test {

struct ProgramResult {
  int status = -1;  ///< exit status; -1 if terminated by a signal
  std::string out;
  std::string err;
};

inline std::string read_file(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

/// Runs a program to completion; arguments must not contain single quotes.
inline ProgramResult run_program(const std::filesystem::path& program,
                                 const std::vector<std::string>& arguments) {
  const TmpDir dir;
  const auto out = dir.path() / "out";
  const auto err = dir.path() / "err";
  const std::string command = fmt::format("'{}' '{}' >'{}' 2>'{}' </dev/null", program.string(),
                                          fmt::join(arguments, "' '"), out.string(), err.string());
  const int raw = std::system(command.c_str());
  return {WIFEXITED(raw) ? WEXITSTATUS(raw) : -1, read_file(out), read_file(err)};
}

}  // namespace apvi::test
