// SPDX-License-Identifier: BSD-3-Clause
#include "config/renamed_keys.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <functional>
#include <optional>
#include <utility>

#include "apvi/core/constants.hpp"
#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/text.hpp"

namespace apvi::config {
namespace {

// The focal length [px] and frame rate for which the old defaults were chosen.
constexpr double kOldFocal_px = 460.0;
constexpr double kOldRate_hz = 20.0;

double degrees_of_pixels(double pixels) {
  return pixels / kOldFocal_px / kRadiansPerDegree;
}

// From the first to the last of consecutive frames, a little less so that jitter of the stamps does
// not demand one more.
double seconds_of_frames(double frames) {
  return std::max(0.0, frames - 1.1) / kOldRate_hz;
}

constexpr auto kRunKeys = std::to_array<RenamedKey>({
    {"dataset.blackout", "dataset.blackout_mode"},
    {"run.pace", "run.playback_rate"},
    {"localization.poses", "localization.poses_file"},
    {"dipo.gravity", "localization.gravity"},
    {"vio.gravity", "localization.gravity"},
    {"dipo.dvl.max_rejected", "dipo.dvl.max_consecutive_rejections"},
    {"dipo.dvl.displacement", "dipo.dvl.use_displacement"},
    {"dipo.dvl.displacement_inflation", "dipo.dvl.displacement_variance_factor"},
    {"dipo.depth.max_rejected", "dipo.depth.max_consecutive_rejections"},
    {"vio.tracker.max_backward_px", "vio.tracker.max_forward_backward_px"},
    {"vio.window.keyframe_parallax_px", "vio.window.keyframe_parallax_deg", degrees_of_pixels},
    {"vio.window.keyframe_survival", "vio.window.keyframe_min_tracked_ratio"},
    {"vio.window.keyframe_interval_s", "vio.window.keyframe_max_interval_s"},
    {"vio.window.iterations", "vio.window.max_iterations"},
    {"vio.window.square_root", "vio.window.square_root_marginalization"},
    {"vio.window.first_estimates", "vio.window.first_estimate_jacobians"},
    {"vio.vision.min_sightings", "vio.vision.min_observations"},
    {"vio.vision.estimate_extrinsics", "vio.calibration.camera_mounting.estimate"},
    {"vio.vision.estimate_time_offset", "vio.calibration.camera_time_offset.estimate"},
    {"vio.vision.information_short", "vio.vision.short_track_weight"},
    {"vio.vision.information_long", "vio.vision.long_track_weight"},
    {"vio.vision.track_short", "vio.vision.short_track_frames"},
    {"vio.vision.track_long", "vio.vision.long_track_frames"},
    {"vio.tight.believed_tracks", "vio.tight.recovery_min_tracks"},
    {"vio.tight.velocity", "vio.tight.use_dvl_velocity"},
    {"vio.tight.depth", "vio.tight.use_depth"},
    {"vio.start", "vio.initialization"},
    {"vio.start.yaw_position_sigma", "vio.initialization.gauge_sigma"},
    {"vio.start.max_wait_s", "vio.initialization.lookback_s"},
    {"vio.start.dvl_s", "vio.initialization.dvl_aiding_s"},
    {"vio.initializer", "vio.initialization_without_dvl"},
    {"vio.initializer.focal_px", ""},
    {"vio.initializer.min_parallax_px", "vio.initialization_without_dvl.min_parallax_deg",
     degrees_of_pixels},
    {"vio.initialization_without_dvl.reference_focal_px", ""},
    {"vio.initialization_without_dvl.min_parallax_px",
     "vio.initialization_without_dvl.min_parallax_deg", degrees_of_pixels},
    {"vio.health.max_bad_frames", "vio.health.max_bad_s", seconds_of_frames},
    {"fusion.consistent", "fusion.consistent_method"},
    {"fusion.discriminator.coarse", "fusion.discriminator.tracking"},
    {"fusion.discriminator.coarse.min_spread", "fusion.discriminator.tracking.min_grid_coverage"},
    {"fusion.discriminator.medium", "fusion.discriminator.agreement"},
    {"fusion.discriminator.medium.needs_stable_dipo",
     "fusion.discriminator.agreement.require_stable_dipo"},
    {"fusion.discriminator.fine", "fusion.discriminator.degeneracy"},
    {"fusion.discriminator.fine.min_rotation",
     "fusion.discriminator.degeneracy.min_rotation_eigenvalue"},
    {"fusion.discriminator.fine.min_position",
     "fusion.discriminator.degeneracy.min_position_eigenvalue"},
    {"fusion.discriminator.fine.focal_px", "fusion.discriminator.degeneracy.reference_focal_px"},
    {"fusion.discriminator.fine.normalisation", "fusion.discriminator.degeneracy.normalization"},
    {"fusion.dipo_stability.nis_pings", "fusion.dipo_stability.nis_window_pings"},
    {"fusion.dipo_stability.max_nis", "fusion.dipo_stability.max_median_nis"},
    {"fusion.dipo_stability.max_rotation_sigma_deg", "fusion.dipo_stability.max_tilt_sigma_deg"},
    {"fusion.dipo_stability.max_position_growth",
     "fusion.dipo_stability.max_position_sigma_growth_m_s"},
    {"fusion.hysteresis.good_frames", "fusion.hysteresis.good_s", seconds_of_frames},
    {"fusion.hysteresis.bad_frames", "fusion.hysteresis.bad_s", seconds_of_frames},
    {"freeze.release_frames", "freeze.release_s", seconds_of_frames},
    {"fusion.hysteresis.return_factor", "fusion.hysteresis.recovery_stable_ratio_factor"},
    {"fusion.relative.shared_noise", "fusion.relative.shared_noise_fraction"},
    {"fusion.relative.min_rotation_walk_deg", "fusion.relative.min_rotation_walk_deg_sqrt_s"},
    {"fusion.relative.min_position_walk", "fusion.relative.min_position_walk_m_sqrt_s"},
    {"fusion.relative.tie_rotation_deg", "fusion.relative.pose_noise_deg"},
    {"fusion.relative.tie_position_m", "fusion.relative.pose_noise_m"},
    {"fusion.relative.gate", "fusion.relative.nis_gate"},
    {"fusion.relative.growth_s", "fusion.relative.drift_smoothing_s"},
    {"mapping.initial_count", "mapping.initial_random_points"},
    {"mapping.coarsest", "mapping.initial_downscale"},
    {"mapping.coarse_until", "mapping.full_resolution_after"},
    {"mapping.sh_interval", "mapping.sh_degree_interval"},
    {"mapping.smoothness", "mapping.depth_curvature_weight"},
    {"mapping.auto_gain", "mapping.gain_compensation"},
    {"mapping.densify.begin", "mapping.densify.start_fraction"},
    {"mapping.densify.end", "mapping.densify.end_fraction"},
    {"mapping.densify.dense_fraction", "mapping.densify.split_scale"},
    {"mapping.rates", "mapping.learning_rates"},
    {"mapping.rates.late_factor", "mapping.learning_rates.final_factor"},
    {"mapping.poses", "mapping.pose_refinement"},
    {"mapping.poses.begin", "mapping.pose_refinement.start_fraction"},
    {"mapping.poses.rate", "mapping.pose_refinement.learning_rate"},
    {"mapping.poses.sigma_m", "mapping.pose_refinement.prior_sigma_m"},
    {"mapping.poses.sigma_deg", "mapping.pose_refinement.prior_sigma_deg"},
    {"mapping.exposure", "mapping.exposure_correction"},
    {"mapping.exposure.rate", "mapping.exposure_correction.learning_rate"},
    {"mapping.exposure.sigma", "mapping.exposure_correction.prior_sigma"},
    {"mapping.online.recent_share", "mapping.online.recent_fraction"},
    {"mapping.online.pyramid_uses", "mapping.online.uses_per_pyramid_level"},
    {"mapping.online.memory_mib", "mapping.online.image_memory_mib"},
    {"mapping.online.heldout_views", "mapping.online.max_heldout_views"},
    {"mapping.online.medium_after", "mapping.online.medium_min_keyframes"},
    {"mapping.online.keyframe_share", "mapping.online.keyframe_budget_fraction"},
    {"mapping.online.growth_share", "mapping.online.densify_budget_fraction"},
    {"mapping.online.densify_interval", "mapping.online.max_densify_interval"},
    {"mapping.online.late_rates", "mapping.online.final_rate_factor"},
    {"mapping.online.late_rates_steps", "mapping.online.rate_decay_steps"},
    {"mapping.online.drift_m", "mapping.online.drift_m_s"},
    {"mapping.online.drift_deg", "mapping.online.drift_deg_s"},
    {"mapping.online.point_sigma", "mapping.online.max_relative_point_sigma"},
    {"mapping.online.opacity", "mapping.online.initial_opacity"},
    {"mapping.online.depth_lag", "mapping.online.depth_lag_keyframes"},
    {"mapping.online.depth_every", "mapping.online.depth_every_keyframes"},
    {"mapping.online.covered_alpha", "mapping.online.coverage_min_alpha"},
    {"mapping.online.covered_error", "mapping.online.coverage_max_error"},
    {"mapping.online.free_space", "mapping.online.free_space_depth_ratio"},
    {"mapping.revisits", "mapping.loop_closure.method"},
    {"mapping.loops", "mapping.loop_closure"},
    {"mapping.loops.least_age_s", "mapping.loop_closure.min_age_s"},
    {"mapping.loops.features", "mapping.loop_closure.max_features"},
    {"mapping.loops.places", "mapping.loop_closure.max_places"},
    {"mapping.loops.least_inliers", "mapping.loop_closure.min_inliers"},
    {"mapping.loops.drift_m", "mapping.loop_closure.drift_m_sqrt_s"},
    {"mapping.loops.drift_deg", "mapping.loop_closure.drift_deg_sqrt_s"},
    {"mapping.depth.near_m", "mapping.depth.min_depth_m"},
    {"mapping.depth.far_m", "mapping.depth.max_depth_m"},
    {"mapping.depth.best_share", "mapping.depth.best_views_fraction"},
    {"mapping.depth.noise", "mapping.depth.intensity_sigma"},
    {"mapping.depth.patch_sigma", "mapping.depth.patch_intensity_sigma"},
    {"mapping.depth.quadtree.largest_px", "mapping.depth.quadtree.max_block_px"},
    {"mapping.depth.quadtree.smallest_px", "mapping.depth.quadtree.min_block_px"},
    {"mapping.depth.quadtree.threshold", "mapping.depth.quadtree.split_threshold"},
    {"mapping.depth.belief", "mapping.depth.belief_propagation"},
    {"mapping.depth.belief.step", "mapping.depth.belief_propagation.cost_per_step"},
    {"mapping.depth.belief.limit", "mapping.depth.belief_propagation.max_cost"},
    {"mapping.depth.confidence.least", "mapping.depth.confidence.min_confidence"},
    {"mapping.depth.confidence.good_cost", "mapping.depth.confidence.half_confidence_cost"},
    {"mapping.depth.confidence.uniqueness", "mapping.depth.confidence.uniqueness_margin"},
    {"mapping.depth.confidence.neighbors", "mapping.depth.confidence.neighbor_fraction"},
    {"mapping.depth.confidence.relative_sigma", "mapping.depth.confidence.max_relative_sigma"},
});
constexpr auto kRunValues = std::to_array<RenamedValue>({
    {"mapping.loop_closure.method", "loops", "pose_graph"},
});
constexpr auto kSceneKeys = std::to_array<RenamedKey>({
    {"world.life", "world.marine_life"},
    {"world.bare", "world.bare_patches"},
    {"water.veil", "water.veiling_light"},
    {"water.veil_gradient", "water.veiling_light_gradient"},
    {"light.sun_share", "light.direct_fraction"},
    {"light.lamp.colour", "light.lamp.color"},
    {"light.lamp.beam_deg", "light.lamp.half_beam_deg"},
    {"motion.aspect", "motion.aspect_ratio"},
    {"motion.file_place", "motion.file_at_origin"},
    {"motion.centre", "motion.look_at"},
    {"imu.gyro_bias", "imu.gyro_bias_sigma"},
    {"imu.accel_bias", "imu.accel_bias_sigma"},
    {"dvl.relock_s", "dvl.relock_duration_s"},
    {"dvl.relock_share", "dvl.relock_probability"},
    {"dvl.outlier_share", "dvl.outlier_fraction"},
    {"dvl.outlier_m_s", "dvl.max_outlier_m_s"},
});
constexpr auto kSceneValues = std::to_array<RenamedValue>({
    {"motion.look", "centre", "point"},
});

// What follows `section` in a dotted key: "" for the section itself, ".rest" for a key in it.
std::optional<std::string_view> remainder(std::string_view key, std::string_view section) {
  if (!key.starts_with(section)) return std::nullopt;
  const std::string_view rest = key.substr(section.size());
  return rest.empty() || rest.front() == '.' ? std::optional(rest) : std::nullopt;
}

// A dotted key without its last part, and the last part.
std::pair<std::string_view, std::string_view> split_last(std::string_view key) {
  const std::size_t dot = key.rfind('.');
  if (dot == std::string_view::npos) return {"", key};
  return {key.substr(0, dot), key.substr(dot + 1)};
}

std::vector<std::string_view> parts_of(std::string_view key) {
  std::vector<std::string_view> parts;
  if (!key.empty()) text::split(key, '.', parts);
  return parts;
}

Node* find_value(Node& root, std::string_view key) {
  Node* node = &root;
  for (const std::string_view part : parts_of(key)) {
    node = const_cast<Node*>(node->find(part));
    if (node == nullptr) break;
  }
  return node;
}

// Removes a value and returns it; nothing if it is absent.
std::optional<Node> extract(Node& root, std::string_view key) {
  const auto split = split_last(key);
  Node* parent = find_value(root, split.first);
  if (parent == nullptr) return std::nullopt;
  const auto it = std::find_if(parent->members.begin(), parent->members.end(),
                               [&](const auto& member) { return member.first == split.second; });
  if (it == parent->members.end()) return std::nullopt;
  Node value = std::move(it->second);
  parent->members.erase(it);
  return value;
}

Node& create_section(Node& root, std::string_view section, const Node& content) {
  Node* node = &root;
  for (const std::string_view part : parts_of(section)) {
    node = &node->member(part);
    if (node->kind != Node::Kind::map && !node->is_null()) {
      fail_at(*node, section, "expected nested keys");
    }
    node->kind = Node::Kind::map;
    if (node->source) continue;
    node->source = content.source;
    node->line = content.line;
  }
  return *node;
}

// Inserts a value under its new key, sections key by key. `inserted`: new keys set so far; several
// old keys may set one to the same value.
void insert(Node& root, const std::string& new_key, const std::string& old_key, Node value,
            std::set<std::string>& inserted) {
  if (value.kind == Node::Kind::map) {
    for (auto& [name, member] : value.members) {
      insert(root, fmt::format("{}.{}", new_key, name), fmt::format("{}.{}", old_key, name),
             std::move(member), inserted);
    }
    return;
  }
  const auto [section, name] = split_last(new_key);
  Node& parent = create_section(root, section, value);
  const Node* existing = parent.find(name);
  if (existing != nullptr && (!inserted.contains(new_key) || existing->text != value.text)) {
    fail_at(value, old_key,
            fmt::format("this key is now {}, which is given too; delete one of them", new_key));
  }
  parent.member(name) = std::move(value);
  inserted.insert(new_key);
}

// A number in another unit; anything else is left to the reader of the new key.
void convert(Node& value, double (*to_new_unit)(double)) {
  const std::optional<double> number = text::parse_double(value.text);
  if (value.kind == Node::Kind::scalar && number)
    value.text = fmt::format("{:.4g}", to_new_unit(*number));
}

std::string place(const Node& node) {
  return node.line > 0 ? node.where() : "--set";
}

std::string to_row(const RenamedKey& key) {
  if (key.new_key.empty()) return fmt::format("| `{}` | none: it has no effect |\n", key.old_key);
  const std::string unit =
      key.convert == nullptr ? "" : fmt::format("; 10 becomes {:.4g}", key.convert(10.0));
  return fmt::format("| `{}` | `{}`{} |\n", key.old_key, key.new_key, unit);
}

}  // namespace

const Renames& run_renames() {
  static constexpr Renames kRenames{kRunKeys, kRunValues};
  return kRenames;
}

const Renames& scene_renames() {
  static constexpr Renames kRenames{kSceneKeys, kSceneValues};
  return kRenames;
}

KeyRenamer::KeyRenamer(const Renames& renames, Warnings warnings)
    : keys_(renames.keys.begin(), renames.keys.end()),
      values_(renames.values),
      warnings_(warnings) {
  const auto depth = [](const RenamedKey& key) {
    return std::count(key.old_key.begin(), key.old_key.end(), '.');
  };
  std::stable_sort(keys_.begin(), keys_.end(),
                   [&](const RenamedKey& a, const RenamedKey& b) { return depth(a) > depth(b); });
}

void KeyRenamer::apply(Node& layer) {
  std::set<std::string> inserted;
  for (const RenamedKey& key : keys_) rename(layer, key, inserted);
  for (const RenamedValue& value : values_) {
    Node* node = find_value(layer, value.key);
    if (node == nullptr || node->kind != Node::Kind::scalar || node->text != value.old_value) {
      continue;
    }
    warn(*node, fmt::format("{}: {}", value.key, value.old_value), value.new_value);
    node->text = value.new_value;
  }
}

void KeyRenamer::rename(Node& layer, const RenamedKey& key, std::set<std::string>& inserted) {
  std::optional<Node> value = extract(layer, key.old_key);
  // A section without keys: these have been moved before.
  if (!value || (value->kind == Node::Kind::map && value->members.empty())) return;
  if (key.new_key.empty()) return warn_dropped(*value, key.old_key);
  if (key.convert != nullptr) convert(*value, key.convert);
  warn(*value, key.old_key, key.new_key);
  insert(layer, std::string(key.new_key), std::string(key.old_key), std::move(*value), inserted);
}

std::string KeyRenamer::renamed(std::string_view key) const {
  for (const RenamedKey& candidate : keys_) {
    const auto rest = remainder(key, candidate.old_key);
    if (rest && !candidate.new_key.empty()) return std::string(candidate.new_key).append(*rest);
  }
  return std::string(key);
}

void KeyRenamer::apply_override(Node& root, std::string_view assignment) {
  const Override parsed = parse_override(assignment);
  Node layer;
  set_value(layer, parsed.key, parsed.value);
  apply(layer);
  const std::string key = renamed(parsed.key);
  const std::string& first = overridden_.emplace(key, parsed.key).first->second;
  if (first != parsed.key && (first == key || parsed.key == key)) {
    fail_input("--set: {} and {} are the same key; delete one of them", first, parsed.key);
  }
  if (const Node* value = find_value(layer, key)) set_value(root, key, *value);
  merge(root, layer);
}

void KeyRenamer::warn(const Node& node, std::string_view old_name, std::string_view new_name) {
  if (!is_first_warning(old_name)) return;
  log::warning("{}: {} is now {}; the old name works until {}", place(node), old_name, new_name,
               kOldNamesUntil);
}

void KeyRenamer::warn_dropped(const Node& node, std::string_view key) {
  if (!is_first_warning(key)) return;
  log::warning("{}: {} has no effect any more; delete it before {}", place(node), key,
               kOldNamesUntil);
}

bool KeyRenamer::is_first_warning(std::string_view old_name) {
  return warnings_ == Warnings::on && warned_.emplace(old_name).second;
}

Node load_config(const std::filesystem::path& file, const std::vector<std::string>& overrides,
                 const Renames& renames, const std::vector<std::filesystem::path>& search) {
  KeyRenamer renamer(renames);
  Node root = load_with_inheritance(
      file, [&](Node& layer) { renamer.apply(layer); }, search);
  for (const std::string& assignment : overrides) renamer.apply_override(root, assignment);
  return root;
}

Node load_recorded_config(const std::filesystem::path& file, const Renames& renames) {
  Node root = load_file(file);
  KeyRenamer(renames, KeyRenamer::Warnings::off).apply(root);
  return root;
}

std::string to_markdown(const Renames& renames) {
  std::string out = "| old | new |\n|---|---|\n";
  for (const RenamedKey& key : renames.keys) out += to_row(key);
  for (const RenamedValue& value : renames.values) {
    out += fmt::format("| `{}: {}` | `{}: {}` |\n", value.key, value.old_value, value.key,
                       value.new_value);
  }
  return out;
}

}  // namespace apvi::config
