// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

namespace apvi {

/// Random number generator with the same output on every compiler and machine, which the standard
/// library's distributions do not guarantee: xoshiro256++ seeded by SplitMix64 (Blackman and Vigna,
/// https://prng.di.unimi.it).
class Random {
 public:
  explicit Random(std::uint64_t seed);
  /// An independent stream for `key`, so that results do not depend on how work is split.
  Random fork(std::uint64_t key) const;

  std::uint64_t next();
  /// Uniform in [0, 1).
  double uniform();
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  /// Standard normal, by Marsaglia's polar method.
  double normal();
  double normal(double mean, double sigma) { return mean + sigma * normal(); }

 private:
  std::uint64_t seed_;
  std::uint64_t state_[4] = {};
  double spare_ = 0.0;
  bool has_spare_ = false;
};

}  // namespace apvi
