// SPDX-License-Identifier: BSD-3-Clause
#include <memory>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "apvi/core/error.hpp"
#include "fuzz/fuzz_target.hpp"
#include "map_io/compressed_ply.hpp"
#include "map_io/ply_table.hpp"

// PLY files: the table of the vertices, and compressed maps.

namespace {

using namespace apvi;

void read_all(map_io::PlyTable& table) {
  const std::size_t width = table.element().properties.size();
  std::vector<float> numbers(static_cast<std::size_t>(table.rows()) * width);
  if (numbers.empty()) return;
  std::vector<map_io::PlyColumn> columns;
  for (std::size_t i = 0; i < width; ++i) {
    columns.push_back(
        {.property = i, .to = numbers.data() + i, .stride = static_cast<std::int64_t>(width)});
  }
  table.read(columns);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  const auto open = [&](std::string_view element) {
    return map_io::PlyTable(std::make_unique<std::istringstream>(bytes), "fuzz.ply", element);
  };
  try {
    map_io::PlyTable table = open("vertex");
    if (map_io::is_compressed_ply(table.header())) {
      const map_io::Splats splats = map_io::read_compressed_ply(open);
      fuzz::check(splats.means.size() == 3 * splats.count, "means have another size");
    }
    read_all(table);
  } catch (const InputError&) {
  }
  return 0;
}
