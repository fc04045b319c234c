// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "apvi/core/error.hpp"
#include "map_io/gzip.hpp"
#include "map_io/quantization.hpp"
#include "map_io/spz.hpp"
#include "map_io/spz_layout.hpp"

namespace apvi::map_io {
namespace {

constexpr int kFractionalBits = 12;
constexpr double kMaxFixedPoint = 8388607.0;  // 24 bits
// Buckets of SH bytes; zero is the center of one. Coarse ones compress better.
constexpr int kFirstDegreeBucket = 8;
constexpr int kBucket = 16;

using Bytes = std::vector<unsigned char>;

unsigned char to_byte(double value) {
  return static_cast<unsigned char>(std::clamp(std::round(value), 0.0, 255.0));
}

void put(Bytes& bytes, std::uint32_t word, int count) {
  for (int i = 0; i < count; ++i, word >>= 8U) {
    bytes.push_back(static_cast<unsigned char>(word & 255U));
  }
}

int fractional_bits(const Splats& splats) {
  double most = 0.0;
  for (const float x : splats.means) most = std::max(most, std::abs(double{x}));
  int bits = kFractionalBits;
  while (bits > 0 && std::ldexp(most, bits) > kMaxFixedPoint) --bits;
  if (std::ldexp(most, bits) > kMaxFixedPoint) {
    fail_input("SPZ cannot store a position {:.0f} km from the origin", most / 1000.0);
  }
  return bits;
}

void put_header(Bytes& bytes, const SpzSplats& map, int bits) {
  const std::size_t rest = map.splats.rest;
  put(bytes, kSpzMagic, 4);
  put(bytes, 3, 4);
  put(bytes, static_cast<std::uint32_t>(map.splats.count), 4);
  bytes.push_back(rest == 0 ? 0 : rest == 3 ? 1 : rest == 8 ? 2 : 3);
  bytes.push_back(static_cast<unsigned char>(bits));
  bytes.push_back(map.antialiased ? kSpzAntialiased : 0);
  bytes.push_back(0);
}

void put_positions(Bytes& bytes, const Splats& splats, int bits) {
  for (std::size_t i = 0; i < splats.means.size(); ++i) {
    const double fixed = std::round(std::ldexp(kSpzAxes[i % 3] * splats.means[i], bits));
    put(bytes, static_cast<std::uint32_t>(static_cast<std::int32_t>(fixed)), 3);
  }
}

void put_rotations(Bytes& bytes, const Splats& splats) {
  for (std::size_t i = 0; i < splats.count; ++i) {
    const float* q = splats.quaternions.data() + 4 * i;
    const Four xyzw = {kSpzAxes[0] * q[1], kSpzAxes[1] * q[2], kSpzAxes[2] * q[3], q[0]};
    put(bytes, pack_signed_rotation(xyzw), 4);
  }
}

unsigned char sh_byte(double value, std::size_t coefficient) {
  const int bucket = coefficient < 3 ? kFirstDegreeBucket : kBucket;
  const double limited = std::clamp(value, -1.0, 1.0);
  const int byte = static_cast<int>(std::round(limited * kSpzShScale) + kSpzShScale);
  return static_cast<unsigned char>(std::min(255, (byte + bucket / 2) / bucket * bucket));
}

void put_sh(Bytes& bytes, const Splats& splats) {
  for (std::size_t i = 0; i < splats.sh_rest.size(); ++i) {
    const std::size_t coefficient = i / 3 % splats.rest;
    bytes.push_back(sh_byte(kSpzShSigns[coefficient] * splats.sh_rest[i], coefficient));
  }
}

}  // namespace

void write_spz(std::ostream& out, const SpzSplats& map) {
  const Splats& splats = map.splats;
  const int bits = fractional_bits(splats);
  Bytes bytes;
  bytes.reserve(kSpzHeaderBytes + splats.count * (20 + 3 * splats.rest));
  put_header(bytes, map, bits);
  put_positions(bytes, splats, bits);
  for (const float x : splats.logit_opacities) bytes.push_back(to_byte(255.0 * sigmoid(x)));
  for (const float x : splats.sh_dc) bytes.push_back(to_byte(255.0 * (kSpzColorScale * x + 0.5)));
  for (const float x : splats.log_scales) {
    bytes.push_back(to_byte(kSpzScaleSteps * (x - kSpzMinLogScale)));
  }
  put_rotations(bytes, splats);
  put_sh(bytes, splats);
  write_gzip(out, bytes);
}

}  // namespace apvi::map_io
