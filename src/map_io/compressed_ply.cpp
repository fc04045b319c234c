// SPDX-License-Identifier: BSD-3-Clause
#include "map_io/compressed_ply.hpp"

#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"
#include "gaussians/render/sh_math.hpp"
#include "map_io/compressed_layout.hpp"
#include "map_io/quantization.hpp"

namespace apvi::map_io {
namespace {

std::vector<double> read_numbers(PlyTable& table, const std::vector<std::string>& names) {
  std::vector<double> numbers(static_cast<std::size_t>(table.rows()) * names.size());
  if (numbers.empty()) return numbers;
  std::vector<PlyColumn> columns;
  for (std::size_t i = 0; i < names.size(); ++i) {
    columns.push_back({.property = table.require_property(names[i]),
                       .stride = static_cast<std::int64_t>(names.size()),
                       .exact = numbers.data() + i});
  }
  table.read(columns);
  return numbers;
}

struct Chunks {
  std::vector<double> bounds;  // [chunks, 12 or 18]
  bool colored = false;        // otherwise colors are in [0, 1]
};

Chunks read_chunks(const PlyOpener& open, std::int64_t vertices) {
  PlyTable table = open("chunk");
  if (table.rows() < (vertices + kChunkSize - 1) / kChunkSize) {
    fail_input("{}: {} chunks for {} Gaussians: one for every {} expected", table.name(),
               table.rows(), vertices, kChunkSize);
  }
  const bool colored = table.find("min_r").has_value();
  std::vector<std::string> names = bound_names();
  if (!colored) names.resize(kPlainBoundCount);
  std::vector<double> numbers = read_numbers(table, names);
  return {std::move(numbers), colored};
}

// Linear between the bounds of a chunk; `begin` is that of the minima.
Three between(const double* begin, const double* unit) {
  Three value{};
  for (std::size_t i = 0; i < 3; ++i) value[i] = begin[i] + unit[i] * (begin[i + 3] - begin[i]);
  return value;
}

void unpack(const double* words, const double* bounds, bool colored, Splats& splats,
            std::size_t i) {
  const auto word = [&](std::size_t k) {
    const double w = words[k];
    return w >= 0.0 && w <= 4294967295.0 ? static_cast<std::uint32_t>(w) : 0U;
  };
  const Three position = between(bounds, unpack_11_10_11(word(0)).data());
  const Four rotation = unpack_rotation(word(1));
  const Three scale = between(bounds + 6, unpack_11_10_11(word(2)).data());
  const Four unit = unpack_8888(word(3));
  const Three color =
      colored ? between(bounds + 12, unit.data()) : Three{unit[0], unit[1], unit[2]};
  for (std::size_t c = 0; c < 3; ++c) {
    splats.means[3 * i + c] = static_cast<float>(position[c]);
    splats.log_scales[3 * i + c] = static_cast<float>(scale[c]);
    splats.sh_dc[3 * i + c] = static_cast<float>((color[c] - 0.5) / gaussians::kSh0);
  }
  for (std::size_t c = 0; c < 4; ++c)
    splats.quaternions[4 * i + c] = static_cast<float>(rotation[c]);
  splats.logit_opacities[i] = logit(unit[3]);
}

// The byte is the number of an interval of [-4, 4]; the first and the last stand for the ends.
float sh_of_byte(double byte) {
  const double unit = byte <= 0.0 ? 0.0 : byte >= 255.0 ? 1.0 : (byte + 0.5) / 256.0;
  return static_cast<float>(kShRange * (unit - 0.5));
}

std::size_t stored_rest(const PlyHeader& header, const std::string& file) {
  const PlyElement* sh = header.find("sh");
  if (sh == nullptr) return 0;
  const std::size_t count = sh->properties.size();
  if (count != 9 && count != 24 && count != 45) {
    fail_input("{}: element sh has {} properties: 9, 24 or 45 expected", file, count);
  }
  return count / 3;
}

void read_sh(PlyTable table, Splats& splats) {
  if (table.rows() != static_cast<std::int64_t>(splats.count)) {
    fail_input("{}: element sh has {} rows, but there are {} Gaussians", table.name(), table.rows(),
               splats.count);
  }
  const std::size_t width = 3 * splats.rest;
  const std::vector<double> bytes = read_numbers(table, rest_names(splats.rest));
  for (std::size_t i = 0; i < splats.count; ++i) {
    for (std::size_t k = 0; k < width; ++k) {
      const std::size_t channel = k / splats.rest;  // all of red, then green, then blue
      splats.sh_rest[i * width + 3 * (k % splats.rest) + channel] =
          sh_of_byte(bytes[i * width + k]);
    }
  }
}

}  // namespace

bool is_compressed_ply(const PlyHeader& header) {
  const PlyElement* const vertices = header.find("vertex");
  return header.find("chunk") != nullptr && vertices != nullptr &&
         vertices->find("packed_position").has_value();
}

Splats read_compressed_ply(const PlyOpener& open) {
  PlyTable vertices = open("vertex");
  const Chunks chunks = read_chunks(open, vertices.rows());
  const std::vector<double> words = read_numbers(vertices, packed_names());
  Splats splats(static_cast<std::size_t>(vertices.rows()),
                stored_rest(vertices.header(), vertices.name()));
  const std::size_t width = chunks.colored ? kBoundCount : kPlainBoundCount;
  for (std::size_t i = 0; i < splats.count; ++i) {
    unpack(words.data() + 4 * i, chunks.bounds.data() + width * (i / kChunkSize), chunks.colored,
           splats, i);
  }
  if (splats.rest > 0) read_sh(open("sh"), splats);
  return splats;
}

}  // namespace apvi::map_io
