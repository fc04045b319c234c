// SPDX-License-Identifier: BSD-3-Clause
#include "runs/diff/diff_frame.hpp"

#include <nlohmann/json.hpp>
#include <string>

#include "apvi/core/error.hpp"
#include "eval/metrics_file.hpp"
#include "runs/run_config.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

/// In whose map a run was to be found, and whether it was.
struct Relocalized {
  fs::path map;
  bool found = false;
};

Relocalized relocalized(const fs::path& run) {
  const eval::Json metrics = eval::read_metrics(run / "metrics.json");
  const auto section = metrics.find("relocalization");
  if (section == metrics.end() || !section->is_object()) return {};
  return {section->value("map", ""), section->value("found", false)};
}

bool is_same(const fs::path& a, const fs::path& b) {
  std::error_code ignored;
  return fs::equivalent(a, b, ignored);
}

bool has_given_poses(const fs::path& run) {
  return !load_recorded_run_config(run / "resolved.yaml").localization.enabled;
}

[[noreturn]] void fail(const fs::path& before, const fs::path& after, const std::string& reason) {
  fail_input(
      "{}: {}; run it again with apvi run DIVE --map {}, or use --same-frame if both runs have the "
      "same coordinates",
      after.string(), reason, before.string());
}

}  // namespace

void check_common_frame(const fs::path& before, const fs::path& after) {
  const Relocalized first = relocalized(before);
  const Relocalized second = relocalized(after);
  if (second.found && is_same(second.map, before)) return;
  if (first.found && is_same(first.map, after)) return;
  if (first.found && second.found && is_same(first.map, second.map)) return;
  if (has_given_poses(before) && has_given_poses(after)) return;
  if (second.map.empty()) fail(before, after, "its frame is its own");
  if (!second.found) fail(before, after, "it was not found in the map of " + second.map.string());
  fail(before, after, "it is in the frame of " + second.map.string());
}

}  // namespace apvi::runs
