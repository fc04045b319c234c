// SPDX-License-Identifier: BSD-3-Clause
#include "map_io/quantization.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "map_io/splats.hpp"

namespace apvi::map_io {
namespace {

constexpr double kHalfRoot = 0.70710678118654752;
constexpr double kSignedMax = 511.0;  // nine bits of magnitude

// Unit, with the largest component positive.
struct Oriented {
  Four q;
  std::size_t largest = 0;
};

Oriented orient(const Four& quaternion) {
  Oriented result{quaternion};
  double norm = 0.0;
  for (std::size_t i = 0; i < 4; ++i) {
    norm += quaternion[i] * quaternion[i];
    if (std::abs(quaternion[i]) > std::abs(quaternion[result.largest])) result.largest = i;
  }
  const double scale = std::copysign(1.0 / std::sqrt(norm), quaternion[result.largest]);
  for (double& component : result.q) component *= scale;
  return result;
}

void fill_largest(Four& q, std::size_t largest) {
  q[largest] = 0.0;
  double sum = 0.0;
  for (const double component : q) sum += component * component;
  q[largest] = std::sqrt(std::max(0.0, 1.0 - sum));
}

// The index of the largest component, then ten bits for each of the others.
template <typename Encode>
std::uint32_t pack_components(const Four& quaternion, const Encode& encode) {
  const auto& [q, largest] = orient(quaternion);
  auto word = static_cast<std::uint32_t>(largest);
  for (std::size_t i = 0; i < 4; ++i) {
    if (i != largest) word = word << 10U | encode(q[i]);
  }
  return word;
}

template <typename Decode>
Four unpack_components(std::uint32_t word, const Decode& decode) {
  const std::size_t largest = word >> 30U;
  Four q{};
  unsigned shift = 20;
  for (std::size_t i = 0; i < 4; ++i) {
    if (i == largest) continue;
    q[i] = decode(word >> shift);
    shift -= 10;  // wraps after the last one
  }
  fill_largest(q, largest);
  return q;
}

}  // namespace

std::uint32_t to_unorm(double value, int bits) {
  const double most = static_cast<double>((1U << bits) - 1U);
  if (!(value > 0.0)) return 0;
  return static_cast<std::uint32_t>(std::floor(std::min(1.0, value) * most + 0.5));
}

double from_unorm(std::uint32_t value, int bits) {
  const std::uint32_t most = (1U << bits) - 1U;
  return static_cast<double>(value & most) / static_cast<double>(most);
}

std::uint32_t pack_11_10_11(const Three& value) {
  return to_unorm(value[0], 11) << 21U | to_unorm(value[1], 10) << 11U | to_unorm(value[2], 11);
}

Three unpack_11_10_11(std::uint32_t word) {
  return {from_unorm(word >> 21U, 11), from_unorm(word >> 11U, 10), from_unorm(word, 11)};
}

std::uint32_t pack_8888(const Four& value) {
  std::uint32_t word = 0;
  for (const double part : value) word = word << 8U | to_unorm(part, 8);
  return word;
}

Four unpack_8888(std::uint32_t word) {
  return {from_unorm(word >> 24U, 8), from_unorm(word >> 16U, 8), from_unorm(word >> 8U, 8),
          from_unorm(word, 8)};
}

std::uint32_t pack_rotation(const Four& quaternion) {
  return pack_components(quaternion,
                         [](double part) { return to_unorm(part * kHalfRoot + 0.5, 10); });
}

Four unpack_rotation(std::uint32_t word) {
  return unpack_components(
      word, [](std::uint32_t part) { return (from_unorm(part, 10) - 0.5) / kHalfRoot; });
}

std::uint32_t pack_signed_rotation(const Four& quaternion) {
  return pack_components(quaternion, [](double part) {
    const std::uint32_t negative = part < 0.0 ? 1 : 0;
    return negative << 9U | to_unorm(std::abs(part) / kHalfRoot, 9);
  });
}

Four unpack_signed_rotation(std::uint32_t word) {
  return unpack_components(word, [](std::uint32_t part) {
    const double size = kHalfRoot * static_cast<double>(part & 511U) / kSignedMax;
    return (part & 512U) != 0 ? -size : size;
  });
}

float logit(double opacity) {
  if (!(opacity > 0.0)) return -kOpaqueLogit;
  if (!(opacity < 1.0)) return kOpaqueLogit;
  return static_cast<float>(std::log(opacity / (1.0 - opacity)));
}

double sigmoid(double logit) {
  return 1.0 / (1.0 + std::exp(-logit));
}

}  // namespace apvi::map_io
