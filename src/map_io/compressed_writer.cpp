// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <ostream>
#include <vector>

#include "gaussians/render/sh_math.hpp"
#include "map_io/compressed_layout.hpp"
#include "map_io/compressed_ply.hpp"
#include "map_io/quantization.hpp"

namespace apvi::map_io {
namespace {

constexpr double kMaxLogScale = 20.0;
constexpr int kMortonBits = 21;

/// Smallest and largest value along three axes.
struct Bounds {
  Three low{};
  Three high{};

  template <typename Value>
  Bounds(const std::vector<std::size_t>& rows, const Value& value) {
    low.fill(std::numeric_limits<double>::infinity());
    high.fill(-std::numeric_limits<double>::infinity());
    for (const std::size_t row : rows) {
      for (std::size_t c = 0; c < 3; ++c) {
        low[c] = std::min(low[c], value(row, c));
        high[c] = std::max(high[c], value(row, c));
      }
    }
    // As the file has them, so that the fractions are those between its numbers.
    for (std::size_t c = 0; c < 3; ++c) {
      low[c] = static_cast<float>(low[c]);
      high[c] = static_cast<float>(high[c]);
    }
  }

  template <typename Value>
  Three fraction(std::size_t row, const Value& value) const {
    Three result{};
    for (std::size_t c = 0; c < 3; ++c) {
      const double extent = high[c] - low[c];
      result[c] = extent > 0.0 ? (value(row, c) - low[c]) / extent : 0.0;
    }
    return result;
  }
};

// The bits of a number at every third place.
std::uint64_t spread(std::uint64_t number) {
  std::uint64_t result = 0;
  for (unsigned bit = 0; bit < kMortonBits; ++bit) result |= (number >> bit & 1U) << (3U * bit);
  return result;
}

std::vector<std::size_t> morton_order(const Splats& splats) {
  std::vector<std::size_t> order(splats.count);
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto mean = [&](std::size_t i, std::size_t c) { return double{splats.means[3 * i + c]}; };
  const Bounds bounds(order, mean);
  std::vector<std::uint64_t> keys(splats.count);
  for (const std::size_t i : order) {
    const Three unit = bounds.fraction(i, mean);
    for (std::size_t c = 0; c < 3; ++c) keys[i] |= spread(to_unorm(unit[c], kMortonBits)) << c;
  }
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return keys[a] < keys[b]; });
  return order;
}

/// Packs the Gaussians of one chunk.
class Packer {
 public:
  explicit Packer(const Splats& splats) : s_(splats) {}

  void pack(const std::vector<std::size_t>& rows) {
    const auto mean = [&](std::size_t i, std::size_t c) { return double{s_.means[3 * i + c]}; };
    const auto scale = [&](std::size_t i, std::size_t c) {
      return std::clamp(double{s_.log_scales[3 * i + c]}, -kMaxLogScale, kMaxLogScale);
    };
    const auto color = [&](std::size_t i, std::size_t c) {
      return gaussians::kSh0 * s_.sh_dc[3 * i + c] + 0.5;
    };
    const Bounds means(rows, mean);
    const Bounds scales(rows, scale);
    const Bounds colors(rows, color);
    for (const Bounds* b : {&means, &scales, &colors}) {
      for (const Three* end : {&b->low, &b->high})
        bounds.insert(bounds.end(), end->begin(), end->end());
    }
    for (const std::size_t i : rows) {
      const float* q = s_.quaternions.data() + 4 * i;
      const Three rgb = colors.fraction(i, color);
      words.push_back(pack_11_10_11(means.fraction(i, mean)));
      words.push_back(pack_rotation({q[0], q[1], q[2], q[3]}));
      words.push_back(pack_11_10_11(scales.fraction(i, scale)));
      words.push_back(pack_8888({rgb[0], rgb[1], rgb[2], sigmoid(s_.logit_opacities[i])}));
      pack_sh(i);
    }
  }

  std::vector<float> bounds;
  std::vector<std::uint32_t> words;
  std::vector<unsigned char> sh;

 private:
  void pack_sh(std::size_t i) {
    const float* rest = s_.sh_rest.data() + 3 * s_.rest * i;
    for (std::size_t channel = 0; channel < 3; ++channel) {
      for (std::size_t k = 0; k < s_.rest; ++k) {
        const double unit = rest[3 * k + channel] / kShRange + 0.5;
        sh.push_back(static_cast<unsigned char>(std::clamp(std::floor(256.0 * unit), 0.0, 255.0)));
      }
    }
  }

  const Splats& s_;
};

std::string element(const std::string& name, std::size_t rows, const std::string& type,
                    const std::vector<std::string>& properties) {
  std::string text = "element " + name + " " + std::to_string(rows) + "\n";
  for (const std::string& property : properties) {
    text.append("property ").append(type).append(" ").append(property).append("\n");
  }
  return text;
}

template <typename T>
void write_raw(std::ostream& out, const std::vector<T>& values) {
  out.write(reinterpret_cast<const char*>(values.data()),
            static_cast<std::streamsize>(values.size() * sizeof(T)));
}

}  // namespace

void write_compressed_ply(std::ostream& out, const Splats& splats, const std::string& comments) {
  const std::vector<std::size_t> order = morton_order(splats);
  Packer packer(splats);
  std::size_t chunks = 0;
  for (std::size_t begin = 0; begin < splats.count; begin += kChunkSize, ++chunks) {
    const auto first = order.begin() + static_cast<std::ptrdiff_t>(begin);
    const auto left = std::min<std::ptrdiff_t>(kChunkSize, order.end() - first);
    packer.pack({first, first + left});
  }
  out << "ply\nformat binary_little_endian 1.0\n"
      << comments << element("chunk", chunks, "float", bound_names())
      << element("vertex", splats.count, "uint", packed_names());
  if (splats.rest > 0) out << element("sh", splats.count, "uchar", rest_names(splats.rest));
  out << "end_header\n";
  write_raw(out, packer.bounds);
  write_raw(out, packer.words);
  write_raw(out, packer.sh);
}

}  // namespace apvi::map_io
