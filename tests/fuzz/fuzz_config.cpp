// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "apvi/config/fields.hpp"
#include "apvi/config/node.hpp"
#include "apvi/core/error.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/sensors/rig.hpp"
#include "fuzz/fuzz_target.hpp"

// Configuration: YAML, overrides, a rig and a dataset section. NUL separates file and overrides.

namespace {

using namespace apvi;

template <typename F>
void tolerate_input_error(F&& f) {
  try {
    f();
  } catch (const InputError&) {
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto parts = fuzz::split(data, size);
  tolerate_input_error([&] {
    config::Node node = config::parse_yaml(parts[0], "fuzz.yaml");
    for (std::size_t i = 1; i < parts.size(); ++i) {
      tolerate_input_error([&] { config::apply_override(node, parts[i]); });
    }
    tolerate_input_error([&] { make_rig(node); });
    tolerate_input_error([&] {
      io::DatasetConfig dataset;
      config::read(node, dataset);
      // Round trip through YAML; the YAML writer does not preserve invalid UTF-8.
      const auto printable = [](char c) { return c >= ' ' && c <= '~'; };
      if (!std::all_of(dataset.path.begin(), dataset.path.end(), printable)) return;
      io::DatasetConfig again;
      config::read(config::parse_yaml(config::to_yaml(config::to_node(dataset)), "again"), again);
      fuzz::check(again.path == dataset.path && again.start_s == dataset.start_s,
                  "a section changes in a round trip");
    });
  });
  return 0;
}
