// SPDX-License-Identifier: BSD-3-Clause
#include "runs/dive_files.hpp"

#include <fmt/format.h>

#include <fstream>
#include <functional>
#include <string>
#include <string_view>

#include "apvi/core/error.hpp"
#include "apvi/io/tum.hpp"
#include "core/text.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

/// The cells of a line, with its place for errors.
struct Line {
  std::string place;
  std::vector<std::string_view> cells;

  std::int64_t integer(std::size_t column) const {
    const auto value = text::parse_int64(cells[column]);
    if (!value || *value < 0) fail_input("{}: expected a whole number", place);
    return *value;
  }
};

void for_each_line(const fs::path& file, std::size_t columns,
                   const std::function<void(const Line&)>& use) {
  std::ifstream in(file, std::ios::binary);
  std::string line;
  std::vector<std::string_view> cells;
  for (int number = 1; std::getline(in, line); ++number) {
    if (line.empty() || line.front() == '#') continue;
    text::split(line, ',', cells);
    const std::string place = fmt::format("{}:{}", file.string(), number);
    if (cells.size() != columns) fail_input("{}: expected {} columns", place, columns);
    use({place, cells});
  }
}

}  // namespace

void write_sensor_spans(const fs::path& file, const std::vector<SensorSpan>& spans) {
  std::string content = "#sensor,begin [ns],end [ns],samples\n";
  for (const SensorSpan& span : spans) {
    content += fmt::format("{},{},{},{}\n", span.sensor, span.begin.ns, span.end.ns, span.samples);
  }
  io::write_text_file(file, content);
}

std::vector<SensorSpan> read_sensor_spans(const fs::path& file) {
  std::vector<SensorSpan> spans;
  for_each_line(file, 4, [&](const Line& line) {
    spans.push_back({std::string(line.cells[0]), Stamp{line.integer(1)}, Stamp{line.integer(2)},
                     static_cast<std::size_t>(line.integer(3))});
  });
  return spans;
}

void write_loops(const fs::path& file, const std::vector<loop_closure::ClosedLoop>& loops) {
  std::string content = "#from [ns],to [ns]\n";
  for (const auto& loop : loops) content += fmt::format("{},{}\n", loop.from.ns, loop.to.ns);
  io::write_text_file(file, content);
}

std::vector<loop_closure::ClosedLoop> read_loops(const fs::path& file) {
  std::vector<loop_closure::ClosedLoop> loops;
  for_each_line(file, 2, [&](const Line& line) {
    loops.push_back({Stamp{line.integer(0)}, Stamp{line.integer(1)}});
  });
  return loops;
}

}  // namespace apvi::runs
