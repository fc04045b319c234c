// SPDX-License-Identifier: BSD-3-Clause
#include "runs/run_config.hpp"

#include "apvi/core/error.hpp"
#include "apvi/io/rig_file.hpp"
#include "config/renamed_keys.hpp"

namespace apvi::runs {
namespace {

std::string absolute_path(const std::string& path) {
  return path.empty() ? path : std::filesystem::absolute(path).lexically_normal().string();
}

// Depth estimation needs localization: with given poses a map densifies by gradient.
RunConfig defaults_for(const config::Node& node) {
  RunConfig config;
  const config::Node* localization = node.find("localization");
  if (localization == nullptr) return config;
  LocalizationSection section;
  config::read(*localization, section);
  if (!section.enabled) config.mapping.trainer.densify.kind = mapping::Densification::gradient;
  return config;
}

void check_given_poses(const RunConfig& config) {
  const slam::MappingOptions& m = config.mapping;
  if (m.enabled == slam::MapSwitch::off) {
    fail_input("localization.enabled: false with mapping.enabled: false: nothing to do");
  }
  if (!config.smoothing.known_map.empty()) {
    fail_input("{}: given poses are not changed: to be found in a map needs localization",
               config.smoothing.known_map);
  }
  if (m.trainer.densify.kind == mapping::Densification::quadtree) {
    fail_input(
        "mapping.densification: quadtree needs localization; with given poses use none, "
        "gradient or random");
  }
  if (m.trainer.iterations + m.trainer.final_iterations.value_or(0) == 0) {
    fail_input("mapping.iterations: must be positive for a map");
  }
  m.check();
}

}  // namespace

localization::Options localization_options(const RunConfig& config) {
  return {.sensors = config.sensors,
          .run = config.run,
          .dipo = config.dipo,
          .vio = config.vio,
          .fusion = config.fusion,
          .freeze = config.freeze,
          .smoothing = config.smoothing,
          .gravity = config.localization.gravity,
          .heldout_every = config.eval.heldout_every};
}

slam::Options slam_options(const RunConfig& config) {
  return {.localization = localization_options(config), .mapping = config.mapping};
}

void check(const RunConfig& config) {
#if !APVI_WITH_MAPPING
  if (config.mapping.enabled == slam::MapSwitch::on) {
    fail_input("mapping.enabled: true: this build has no mapping (APVI_MAPPING=OFF)");
  }
#endif
  if (!config.localization.enabled) return check_given_poses(config);
  slam_options(config).check();
}

bool makes_map(const RunConfig& config, const io::SequenceReader& recording) {
  if (config.mapping.enabled != slam::MapSwitch::automatic) {
    return config.mapping.enabled == slam::MapSwitch::on;
  }
  if (!APVI_WITH_MAPPING || !config.sensors.includes("camera")) return false;
  const Rig rig = make_rig(resolve_rig(config, recording.rig()));
  return !rig.cameras.empty() && recording.report().contains("camera");
}

RunConfig load_run_config(const std::filesystem::path& file,
                          const std::vector<std::string>& overrides,
                          const std::vector<std::filesystem::path>& search) {
  const config::Node node = config::load_config(file, overrides, config::run_renames(), search);
  RunConfig config = defaults_for(node);
  config::read(node, config);
  check(config);
  return config;
}

RunConfig load_recorded_run_config(const std::filesystem::path& file) {
  const config::Node node = config::load_recorded_config(file, config::run_renames());
  RunConfig config = defaults_for(node);
  config::read(node, config);
  return config;
}

RunConfig resolved(const RunConfig& config, const config::Node& rig) {
  RunConfig copy = config;
  copy.dataset.path = absolute_path(config.dataset.path);
  copy.localization.poses_file = absolute_path(config.localization.poses_file);
  copy.smoothing.known_map = absolute_path(config.smoothing.known_map);
  copy.dataset.rig.clear();  // its content is in `rig`
  copy.rig = rig;
  const std::string& points = config.mapping.initial_points;
  if (points != "sift" && points != "random") {
    copy.mapping.initial_points = absolute_path(points);
  }
  return copy;
}

config::Node resolve_rig(const RunConfig& config, const config::Node& recorded) {
  config::Node rig = recorded;
  if (!config.dataset.rig.empty()) rig = io::load_rig_file(config.dataset.rig);
  if (!config.rig.is_null()) config::merge(rig, config.rig);
  if (rig.is_null()) {
    fail_input("{}: no calibration: add a rig.yaml there, or set dataset.rig", config.dataset.path);
  }
  return rig;
}

}  // namespace apvi::runs
