// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <sstream>
#include <string>

#include "apvi/core/error.hpp"
#include "fuzz/fuzz_target.hpp"
#include "map_io/gzip.hpp"
#include "map_io/spz.hpp"

// SPZ files: the bytes as they are, and what is in the gzip file, which mutations cannot reach.

namespace {

using namespace apvi;

void read(const std::string& file) {
  try {
    const map_io::SpzSplats map = map_io::read_spz({file.begin(), file.end()}, "fuzz.spz");
    for (const float x : map.splats.means) fuzz::check(std::isfinite(x), "a mean is not finite");
    for (const float x : map.splats.quaternions) {
      fuzz::check(std::isfinite(x), "a rotation is not finite");
    }
    for (const float x : map.splats.logit_opacities) {
      fuzz::check(std::isfinite(x), "an opacity is not finite");
    }
  } catch (const InputError&) {
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  read(std::string(reinterpret_cast<const char*>(data), size));
  std::ostringstream out;
  map_io::write_gzip(out, {data, data + size});
  read(out.str());
  return 0;
}
