// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>

#include "apvi/core/error.hpp"
#include "fuzz/fuzz_target.hpp"
#include "importer/mp4.hpp"

// The content of a moov box.

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace apvi;
  try {
    const importer::Mp4Movie movie = importer::parse_moov({data, size}, "fuzz.mp4");
    for (const importer::Mp4Track& track : movie.tracks) {
      for (const importer::Mp4Sample& sample : track.samples) {
        fuzz::check(std::isfinite(sample.time_s), "a time is not finite");
      }
      fuzz::check(std::isfinite(track.first_s()), "the first time is not finite");
    }
  } catch (const InputError&) {
  }
  return 0;
}
