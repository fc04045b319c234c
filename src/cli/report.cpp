// SPDX-License-Identifier: BSD-3-Clause
#include "cli/report.hpp"

#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <thread>

#include "apvi/core/log.hpp"
#include "cli/configurations.hpp"
#include "core/child_process.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;

// Debian's packages belong to Debian's interpreter, whatever else is called python3.
constexpr const char* kPython = "/usr/bin/python3";

ChildExit wait_for(ChildProcess& child) {
  while (true) {
    if (const auto exit = child.poll()) return *exit;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

std::string content(const fs::path& file) {
  std::ifstream in(file);
  std::string text{std::istreambuf_iterator<char>(in), {}};
  while (!text.empty() && text.back() == '\n') text.pop_back();
  return text;
}

}  // namespace

void write_report(const fs::path& folder) {
  const auto script = find_script("report.py");
  if (!script || !fs::exists(kPython)) {
    log::warning("no report.html: {} is not installed", script ? kPython : "report.py");
    return;
  }
  const fs::path output = folder / "report.log";
  ChildProcess child({kPython, "-B", script->string(), folder.string()}, output);
  const ChildExit exit = wait_for(child);
  if (!exit.success()) {
    log::warning("no report.html: {}: {}", exit.text(), content(output));
  }
  std::error_code ignored;
  fs::remove(output, ignored);
}

}  // namespace apvi::cli
