// SPDX-License-Identifier: BSD-3-Clause
#include "map_io/map_file.hpp"

#include <fmt/format.h>

#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <system_error>
#include <vector>

#include "apvi/core/error.hpp"
#include "core/atomic_file.hpp"
#include "core/foreign_file.hpp"
#include "core/text.hpp"
#include "map_io/compressed_ply.hpp"
#include "map_io/map_comments.hpp"
#include "map_io/ply.hpp"
#include "map_io/splat_tensors.hpp"
#include "map_io/spz.hpp"

namespace apvi::map_io {
namespace {

namespace fs = std::filesystem;

enum class Format { ply, compressed_ply, spz };

std::optional<Format> format_of(const fs::path& path) {
  const std::string extension = text::to_lower(path.extension().string());
  if (extension == ".spz") return Format::spz;
  if (extension != ".ply") return std::nullopt;
  const std::string before = text::to_lower(path.stem().extension().string());
  return before == ".compressed" ? Format::compressed_ply : Format::ply;
}

fs::path sidecar(const fs::path& path) {
  return path.string() + ".origin.json";
}

Origin read_origin_json(const fs::path& path) {
  std::ifstream in(path);
  if (!in) return {};
  try {
    return nlohmann::json::parse(in).at("origin_m").get<Origin>();
  } catch (const nlohmann::json::exception& e) {
    fail_input("{}: expected origin_m, three numbers: {}", path.string(), e.what());
  }
}

std::vector<unsigned char> read_bytes(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) fail_input("{}: cannot be read; does the file exist?", path.string());
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

bool begins_as_gzip(const fs::path& path) {
  if (fs::is_directory(path)) return false;
  std::ifstream in(path, std::ios::binary);
  std::vector<unsigned char> bytes(2);
  in.read(reinterpret_cast<char*>(bytes.data()), 2);
  return is_gzip(bytes);
}

}  // namespace

bool is_map_name(const fs::path& path) {
  return format_of(path).has_value();
}

MapFile read_map(const fs::path& path) {
  if (begins_as_gzip(path)) {
    const SpzSplats spz = read_spz(read_bytes(path), path.string());
    return {.gaussians = to_gaussians(spz.splats),
            .medium = std::nullopt,
            .origin = read_origin_json(sidecar(path)),
            .antialiased = spz.antialiased};
  }
  const auto foreign = is_map_name(path) ? std::nullopt : describe_foreign_file(path);
  if (foreign) fail_input("{}: not a map that is read, but {}", path.string(), *foreign);
  MapFile map{.gaussians = read_ply(path), .medium = std::nullopt};
  const PlyTable table(path);
  map.medium = medium_of(table.header());
  map.origin = origin_of(table.header());
  const CameraResponse camera = camera_response_of(table.header());
  map.tone_curve = camera.tone_curve;
  map.vignetting = camera.vignetting;
  map.gaussians = gaussians::with_decoded_colors(map.gaussians, map.tone_curve);
  return map;
}

void write_map(const fs::path& path, const MapFile& map) {
  const auto format = format_of(path);
  if (!format) fail_input("{}: expected a file .ply, .compressed.ply or .spz", path.string());
  const CameraResponse camera{.tone_curve = map.tone_curve, .vignetting = map.vignetting};
  if (*format == Format::ply) {
    return write_ply(path, map.gaussians, map.medium, map.origin, camera);
  }
  const Splats splats = to_splats(gaussians::with_encoded_colors(map.gaussians, map.tone_curve));
  write_file_atomically(path, [&](std::ostream& out) {
    if (*format == Format::spz) {
      write_spz(out, {splats, map.antialiased});
    } else {
      write_compressed_ply(out, splats, comment_lines(map.medium, map.origin, camera));
    }
  });
  if (*format == Format::spz) write_origin_json(sidecar(path), map.origin);
}

void write_origin_json(const fs::path& path, const Origin& origin) {
  if (is_zero(origin)) {
    std::error_code ignored;
    fs::remove(path, ignored);
    return;
  }
  write_file_atomically(path, [&](std::ostream& out) {
    out << fmt::format("{{\"origin_m\": [{:.17g}, {:.17g}, {:.17g}]}}\n", origin[0], origin[1],
                       origin[2]);
  });
}

}  // namespace apvi::map_io
