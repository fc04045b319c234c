// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apvi/config/node.hpp"
#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/io/tum.hpp"
#include "cli/commands.hpp"
#include "cli/mapping_support.hpp"
#include "config/renamed_keys.hpp"
#include "eval/metrics_file.hpp"
#include "runs/smoothed.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;
using eval::EvalOptions;

struct Arguments {
  fs::path run;
  fs::path reference;
  fs::path estimate;
  fs::path patches;
  std::vector<std::string> overrides;  // "key=value" of EvalOptions
  std::optional<WorldFrame> estimate_world;
  std::optional<WorldFrame> reference_world;
  bool json = false;
};

using Choices = std::vector<std::string>;

void add_override(CLI::App& command, const std::string& flag, const std::string& key, Arguments& a,
                  const Choices& words, const std::string& help) {
  const auto add = [&a, key](const std::string& value) {
    a.overrides.push_back(key + "=" + value);
  };
  CLI::Option* option = command.add_option_function<std::string>(flag, add, help);
  if (words.empty()) {
    option->check(CLI::NonNegativeNumber)->type_name("SECONDS");
  } else {
    option->check(CLI::IsMember(words))->type_name("WORD");
  }
}

void add_world(CLI::App& command, const std::string& flag, std::optional<WorldFrame>& world,
               const std::string& help) {
  const auto set = [&world](const std::string& word) {
    world = word == "ned" ? WorldFrame::ned : WorldFrame::up;
  };
  command.add_option_function<std::string>(flag, set, help)
      ->check(CLI::IsMember({"up", "ned"}))
      ->type_name("WORD");
}

void add_options(CLI::App& command, Arguments& a) {
  add_override(command, "--align", "align", a, {"se3", "sim3", "yaw", "first", "none"},
               "alignment before the comparison: rigid (default), rigid with scale, translation "
               "and heading, "
               "first pose, none");
  add_override(command, "--associate", "associate", a, {"auto", "nearest"},
               "interpolate the denser trajectory (default), or match nearest stamps as evo does");
  add_override(command, "--max-difference", "max_difference_s", a, {},
               "nearest: maximum time difference of a match (default 0.01)");
  add_override(command, "--max-gap", "max_gap_s", a, {},
               "auto, coverage: maximum gap to interpolate over (default 2)");
  add_world(command, "--estimate-world", a.estimate_world,
            "world frame: z up or north-east-down (default: from the run's rig, else up)");
  add_world(command, "--reference-world", a.reference_world,
            "world frame of the reference (default: as the estimate, but up for positions only)");
  command.add_flag("--json", a.json, "print JSON instead of a table");
}

// `section` is the `eval` section of the run's configuration.
EvalOptions options_for(const Arguments& a, const Trajectory& reference, config::Node section,
                        WorldFrame vehicle_world) {
  for (const std::string& assignment : a.overrides) config::apply_override(section, assignment);
  EvalOptions options;
  config::read(section, options, "eval");
  options.estimate_world = a.estimate_world.value_or(vehicle_world);
  options.reference_world =
      a.reference_world.value_or(eval::reference_world(reference, options.estimate_world));
  return options;
}

void check_matched(const eval::TrajectoryMetrics& metrics, const Trajectory& reference,
                   const Trajectory& estimate, const EvalOptions& options,
                   const std::string& name) {
  if (metrics.ate.reason == eval::Reason::no_overlap) {
    fail_input("{}: no time overlap with the reference: {}; do both use the same clock?", name,
               eval::describe_spans(reference, estimate));
  }
  if (metrics.ate.reason == eval::Reason::too_few_matches) {
    const bool nearest = options.association.mode == eval::Association::nearest;
    fail_input("{}: {} poses match the reference, {} required: {}; {}", name, *metrics.matched,
               eval::min_matches(options.alignment), eval::describe_spans(reference, estimate),
               nearest ? "use --associate auto or a larger --max-difference"
                       : "the gaps may be longer than --max-gap");
  }
}

void print(const std::string& text) {
  if (std::fputs(text.c_str(), stdout) < 0 || std::fflush(stdout) != 0) {
    fail_run("standard output: cannot be written");
  }
}

void eval_pair(const Arguments& a) {
  const Trajectory reference = io::read_trajectory(a.reference, io::BadLines::drop);
  const Trajectory estimate = io::read_trajectory(a.estimate);
  const EvalOptions options = options_for(a, reference, {}, WorldFrame::up);
  const eval::RunTrajectories metrics{
      .fused = eval::evaluate(reference, estimate, options), .dipo = {}, .vio = {}};
  check_matched(metrics.fused, reference, estimate, options, a.estimate.string());
  const eval::Json json{{"trajectory", eval::to_json(metrics)}};
  print(a.json ? json.dump(2) + "\n" : eval::to_table(metrics));
}

// Of a run up to scale. A damaged file is reported when it is written.
bool has_unknown_scale(const fs::path& metrics_file) {
  if (!fs::exists(metrics_file)) return false;
  const eval::Json metrics = eval::read_metrics(metrics_file);
  return metrics.contains("scale") && !metrics["scale"].value("known", true);
}

// Reference, world frame and evaluation options of a run.
struct RunContext {
  std::optional<Trajectory> reference;
  WorldFrame world = WorldFrame::up;
  config::Node options;
};

config::Node section(const config::Node& root, std::string_view key) {
  const config::Node* found = root.find(key);
  return found != nullptr ? *found : config::Node{};
}

// The dataset's reference, clipped to the part that the run processed.
std::optional<Trajectory> dataset_reference(const config::Node& resolved) {
  io::DatasetConfig dataset;
  config::read(section(resolved, "dataset"), dataset, "dataset");
  const auto sequence = io::open_sequence(dataset, {});
  auto reference = sequence->reference();
  if (!reference || (dataset.start_s == 0.0 && dataset.duration_s == 0.0)) return reference;
  const auto first = sequence->next();
  if (!first) fail_input("{}: dataset: no samples in this time span", resolved.where());
  return eval::clip_to_run(*reference, stamp_of(*first), dataset.duration_s);
}

RunContext load_run_context(const Arguments& a) {
  RunContext context;
  const fs::path resolved_file = a.run / "resolved.yaml";
  const bool has_resolved = fs::exists(resolved_file);
  if (!has_resolved && a.reference.empty()) {
    fail_input("{}: missing; is this a run folder? Use --reference FILE to evaluate without it",
               resolved_file.string());
  }
  const config::Node resolved =
      has_resolved ? config::load_recorded_config(resolved_file, config::run_renames())
                   : config::Node{};
  context.world = make_rig(section(resolved, "rig")).world;
  context.options = section(resolved, "eval");
  if (has_unknown_scale(a.run / "metrics.json")) {
    config::apply_override(context.options, "align=sim3");
  }
  context.reference = a.reference.empty()
                          ? dataset_reference(resolved)
                          : std::optional(io::read_trajectory(a.reference, io::BadLines::drop));
  return context;
}

eval::TrajectoryMetrics metrics_of(const Trajectory& estimate, const Arguments& a,
                                   const RunContext& context) {
  if (!context.reference) return eval::evaluate_without_reference(estimate);
  return eval::evaluate(*context.reference, estimate,
                        options_for(a, *context.reference, context.options, context.world));
}

std::optional<eval::TrajectoryMetrics> metrics_of_estimator(const fs::path& file,
                                                            const Arguments& a,
                                                            const RunContext& context) {
  if (!fs::exists(file)) return std::nullopt;
  try {
    return metrics_of(io::read_trajectory(file), a, context);
  } catch (const InputError& e) {
    log::warning("{}; skipped", e.what());  // an estimator that never started leaves an empty file
    return std::nullopt;
  }
}

void eval_run(const Arguments& a) {
  if (!fs::is_directory(a.run)) fail_input("{}: no such folder", a.run.string());
  const fs::path file = a.run / "trajectory.tum";
  const Trajectory fused = io::read_trajectory(file);
  const RunContext context = load_run_context(a);
  if (!context.reference)
    log::warning("the dataset has no reference; only the end-to-start distance is evaluated");
  const eval::RunTrajectories metrics{
      .fused = metrics_of(fused, a, context),
      .dipo = metrics_of_estimator(a.run / "dipo.tum", a, context),
      .vio = metrics_of_estimator(a.run / "vio.tum", a, context),
      .smoothed = metrics_of_estimator(a.run / runs::kSmoothedFile, a, context),
      .in_meters = !has_unknown_scale(a.run / "metrics.json")};
  if (context.reference) {
    check_matched(metrics.fused, *context.reference, fused,
                  options_for(a, *context.reference, context.options, context.world),
                  file.string());
  }
  const fs::path metrics_file = a.run / "metrics.json";
  eval::Json sections{{"trajectory", eval::to_json(metrics)}};
  if (metrics.smoothed) {
    sections["smoothed"] = eval::read_metrics(metrics_file).value("smoothed", eval::Json::object());
    sections["smoothed"].update(eval::to_json(*metrics.smoothed));
  }
  eval::merge_metrics(metrics_file, sections);
  print(a.json ? eval::read_metrics(metrics_file).dump(2) + "\n" : eval::to_table(metrics));
}

}  // namespace

void add_eval(CLI::App& app) {
  const auto arguments = std::make_shared<Arguments>();
  Arguments& a = *arguments;
  CLI::App* run = app.add_subcommand(
      "eval", "evaluate a run and update its metrics.json, or compare two trajectories");
  run->add_option("RUN", a.run, "run folder")->type_name("FOLDER");
  run->add_option("--reference", a.reference,
                  "trajectory file to use instead of the dataset's reference")
      ->type_name("FILE");
  run->add_option("--patches", a.patches,
                  "compare the colors of patches in the images, before and after removal of the "
                  "water, with known ones: csv with timestamp, x, y, width, height, red, green, "
                  "blue")
      ->type_name("FILE");
  add_options(*run, a);
  CLI::App* pair = run->add_subcommand("trajectory", "compare two trajectory files");
  pair->add_option("--reference", a.reference, "TUM, EuRoC csv or gnss0/data.csv")
      ->type_name("FILE")
      ->required();
  pair->add_option("--estimate", a.estimate, "estimated trajectory, same formats")
      ->type_name("FILE")
      ->required();
  add_options(*pair, a);
  pair->callback([arguments] { eval_pair(*arguments); });
  run->callback([arguments, pair] {
    if (pair->parsed()) return;
    if (arguments->run.empty()) throw CLI::RequiredError("RUN");
    if (arguments->patches.empty()) {
      eval_run(*arguments);
    } else {
      print(eval_patches(arguments->run, arguments->patches, arguments->json));
    }
  });
}

}  // namespace apvi::cli
