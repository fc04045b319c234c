// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "apvi/core/random.hpp"

namespace apvi::mapping {

/// Separate streams of random numbers, so that one more draw in one place changes no other.
enum class Stream : std::uint64_t { order = 1, split = 2, insertion = 3, survey = 4 };

/// A function of the seed and of how far the work is: a checkpoint needs no generator's state.
inline std::uint64_t seed_of(std::uint64_t seed, Stream stream, std::int64_t round) {
  Random random = Random(seed).fork(static_cast<std::uint64_t>(stream));
  return random.fork(static_cast<std::uint64_t>(round)).next();
}

}  // namespace apvi::mapping
