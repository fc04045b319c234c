// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>

namespace apvi::map_io {

using Three = std::array<double, 3>;
using Four = std::array<double, 4>;

/// A number in [0, 1] as an integer of `bits` bits, rounded; others are clamped, NaN is zero.
std::uint32_t to_unorm(double value, int bits);
/// The lowest `bits` bits as a number in [0, 1].
double from_unorm(std::uint32_t value, int bits);

/// Three numbers in [0, 1] with 11, 10 and 11 bits, the first in the highest bits.
std::uint32_t pack_11_10_11(const Three& value);
Three unpack_11_10_11(std::uint32_t word);
/// Four numbers in [0, 1] with 8 bits each, the first in the highest bits.
std::uint32_t pack_8888(const Four& value);
Four unpack_8888(std::uint32_t word);

/// A rotation as the index of its largest component (2 bits) and the other three in order, each in
/// [-sqrt(1/2), sqrt(1/2)] with 10 bits: offset binary.
std::uint32_t pack_rotation(const Four& quaternion);
Four unpack_rotation(std::uint32_t word);
/// The same with a sign bit and nine bits of magnitude for each of the three.
std::uint32_t pack_signed_rotation(const Four& quaternion);
Four unpack_signed_rotation(std::uint32_t word);

/// Opacity in (0, 1) to its logit; zero and one give -/+ `kOpaqueLogit`.
float logit(double opacity);
double sigmoid(double logit);

}  // namespace apvi::map_io
