// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "apvi/config/fields.hpp"
#include "apvi/config/node.hpp"
#include "apvi/core/error.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/sensors/rig.hpp"
#include "fuzz_target.hpp"

// Configuration: YAML, an override, a rig and a dataset section. NUL separates file and override.

namespace {

using namespace apvi;

template <typename F>
void refusable(F&& f) {
  try {
    f();
  } catch (const InputError&) {
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto parts = fuzz::split(data, size);
  refusable([&] {
    config::Node node = config::parse_yaml(parts[0], "fuzz.yaml");
    for (std::size_t i = 1; i < parts.size(); ++i) {
      refusable([&] { config::apply_override(node, parts[i]); });
    }
    refusable([&] { make_rig(node); });
    refusable([&] {
      io::DatasetConfig dataset;
      config::read(node, dataset);
      // What was read can be written and read again; the YAML writer keeps no broken UTF-8, though.
      const auto printable = [](char c) { return c >= ' ' && c <= '~'; };
      if (!std::all_of(dataset.path.begin(), dataset.path.end(), printable)) return;
      io::DatasetConfig again;
      config::read(config::parse_yaml(config::to_yaml(config::to_node(dataset)), "again"), again);
      fuzz::check(again.path == dataset.path && again.start_s == dataset.start_s,
                  "a section that changes by writing and reading");
    });
  });
  return 0;
}
