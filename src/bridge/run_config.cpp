// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/bridge/run_config.hpp"

#include "apvi/core/error.hpp"

namespace apvi::bridge {
namespace {

void check_mapping(const RunConfig& config) {
  const MappingConfig& m = config.mapping;
  if (m.densify.kind == mapping::Densification::quadtree) {
    fail_input(
        "mapping.densification: quadtree needs localization; with given poses use none, "
        "gradient or random");
  }
  if (!m.initial_box_m.empty()) {
    bool ordered = m.initial_box_m.size() == 6;
    for (std::size_t i = 0; ordered && i < 3; ++i) {
      ordered = m.initial_box_m[i] < m.initial_box_m[i + 3];
    }
    if (!ordered) {
      fail_input("mapping.initial_box_m: expected [x, y, z, x, y, z], the low corner first");
    }
  }
  if (m.trainer.coarsest == 3 || (m.trainer.coarsest > 4 && m.trainer.coarsest < 8)) {
    fail_input("mapping.coarsest: {} is none of 1, 2, 4, 8", m.trainer.coarsest);
  }
  if (m.densify.begin > m.densify.end) {
    fail_input("mapping.densify.begin: {} is after mapping.densify.end, {}", m.densify.begin,
               m.densify.end);
  }
  if (m.trainer.iterations + m.trainer.final_iterations == 0) {
    fail_input("mapping.iterations: 0 steps make no map");
  }
}

void check(const RunConfig& config) {
  if (config.localization.enabled && config.mapping.enabled) {
    fail_input(
        "mapping.enabled: a map needs given poses in this version: set "
        "localization.enabled: false");
  }
  if (!config.localization.enabled && !config.mapping.enabled) {
    fail_input(
        "localization.enabled: with given poses and mapping.enabled: false nothing is left "
        "to do");
  }
  if (config.mapping.enabled) check_mapping(config);
}

}  // namespace

mapping::TrainerOptions trainer_options(const RunConfig& config) {
  mapping::TrainerOptions options = config.mapping.trainer;
  options.seed = static_cast<std::uint64_t>(config.run.seed);
  options.rates = config.mapping.rates;
  options.densify = config.mapping.densify;
  options.poses = config.mapping.poses;
  options.exposure = config.mapping.exposure;
  return options;
}

RunConfig load_run_config(const std::filesystem::path& file,
                          const std::vector<std::string>& overrides) {
  config::Node node = config::load_with_inheritance(file);
  for (const std::string& assignment : overrides) config::apply_override(node, assignment);
  RunConfig config;
  config::read(node, config);
  pipeline::check(config);
  check(config);
  return config;
}

}  // namespace apvi::bridge
