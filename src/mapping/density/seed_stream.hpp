// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "core/random.hpp"

namespace apvi::mapping {

/// Independent random streams, so that an extra draw in one does not change the others.
enum class Stream : std::uint64_t { order = 1, split = 2, insertion = 3, medium = 4 };

/// Derives a seed from the run's seed, the stream and the round, so that checkpoints need no
/// generator state.
inline std::uint64_t derive_seed(std::uint64_t seed, Stream stream, std::int64_t round) {
  Random random = Random(seed).fork(static_cast<std::uint64_t>(stream));
  return random.fork(static_cast<std::uint64_t>(round)).next();
}

}  // namespace apvi::mapping
