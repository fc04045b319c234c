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
#include "apvi/eval/metrics_file.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/io/tum.hpp"
#include "commands.hpp"

namespace apvi::apps {
namespace {

namespace fs = std::filesystem;
using eval::EvalOptions;

template <typename T>
using Words = std::vector<std::pair<std::string, T>>;

struct Arguments {
  fs::path run;
  fs::path reference;
  fs::path estimate;
  EvalOptions options;
  std::optional<WorldFrame> estimate_world;
  std::optional<WorldFrame> reference_world;
  bool json = false;
};

// An option that takes one of some words.
template <typename T, typename Target>
void add_word(CLI::App& command, const std::string& name, Target& target, const Words<T>& words,
              const std::string& help) {
  std::vector<std::string> names;
  for (const auto& [word, value] : words) names.push_back(word);
  const auto set = [&target, words](const std::string& given) {
    for (const auto& [word, value] : words) {
      if (word == given) target = value;
    }
  };
  command.add_option_function<std::string>(name, set, help)
      ->check(CLI::IsMember(names))
      ->type_name("WORD");
}

void add_options(CLI::App& command, Arguments& a) {
  const Words<WorldFrame> worlds = {{"up", WorldFrame::up}, {"ned", WorldFrame::ned}};
  eval::AssociationOptions& association = a.options.association;
  add_word<eval::Alignment>(
      command, "--align", a.options.alignment,
      {{"se3", eval::Alignment::se3},
       {"yaw", eval::Alignment::yaw},
       {"first", eval::Alignment::first},
       {"none", eval::Alignment::none}},
      "taken out before comparing: a rigid motion (default), translation and heading, the first "
      "pose, nothing");
  add_word<eval::Association>(
      command, "--associate", association.mode,
      {{"auto", eval::Association::interpolate}, {"nearest", eval::Association::nearest}},
      "interpolate the denser trajectory (default), or pair the nearest as evo does");
  command
      .add_option("--max-difference", association.max_difference_s,
                  "nearest: largest distance in time of a pair [s]")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command
      .add_option("--max-gap", association.max_gap_s,
                  "auto, coverage: longest gap to interpolate over [s]")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  add_word<WorldFrame>(command, "--estimate-world", a.estimate_world, worlds,
                       "z up or north-east-down (default: from the rig of the run, else up)");
  add_word<WorldFrame>(command, "--reference-world", a.reference_world, worlds,
                       "the same (default: as the estimate, but up for positions only)");
  command.add_flag("--json", a.json, "print JSON instead of a table");
}

EvalOptions options_for(const Arguments& a, const Trajectory& reference, WorldFrame vehicle_world) {
  EvalOptions options = a.options;
  options.estimate_world = a.estimate_world.value_or(vehicle_world);
  options.reference_world =
      a.reference_world.value_or(eval::reference_world(reference, options.estimate_world));
  return options;
}

void check_matched(const eval::TrajectoryMetrics& metrics, const Trajectory& reference,
                   const Trajectory& estimate, const EvalOptions& options,
                   const std::string& name) {
  if (metrics.ate.reason == eval::Reason::no_overlap) {
    fail_input("{}: has no time in common with the reference: {}; are both on one clock?", name,
               eval::describe_spans(reference, estimate));
  }
  if (metrics.ate.reason == eval::Reason::too_few_matches) {
    const bool nearest = options.association.mode == eval::Association::nearest;
    fail_input("{}: {} poses match the reference, {} are needed: {}; {}", name, *metrics.matched,
               eval::needed_matches(options.alignment), eval::describe_spans(reference, estimate),
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
  const Trajectory reference = io::read_trajectory(a.reference);
  const Trajectory estimate = io::read_trajectory(a.estimate);
  const EvalOptions options = options_for(a, reference, WorldFrame::up);
  const eval::RunTrajectories metrics{
      .fused = eval::evaluate(reference, estimate, options), .dipo = {}, .vio = {}};
  check_matched(metrics.fused, reference, estimate, options, a.estimate.string());
  const eval::Json json{{"trajectory", eval::to_json(metrics)}};
  print(a.json ? json.dump(2) + "\n" : eval::to_table(metrics));
}

// What a run was made from.
struct Origin {
  std::optional<Trajectory> reference;
  WorldFrame world = WorldFrame::up;
};

Origin open_origin(const fs::path& run) {
  const fs::path resolved = run / "resolved.yaml";
  if (!fs::exists(resolved)) {
    fail_input("{}: missing; is this a run folder? --reference FILE works without it",
               resolved.string());
  }
  const config::Node root = config::load_file(resolved);
  io::DatasetConfig dataset;
  if (const config::Node* node = root.find("dataset")) config::read(*node, dataset, "dataset");
  const auto sequence = io::open_sequence(dataset, {});
  Origin origin;
  if (!sequence->rig().is_null()) origin.world = make_rig(sequence->rig()).world;
  origin.reference = sequence->reference();
  const bool whole = dataset.start_s == 0.0 && dataset.duration_s == 0.0;
  if (whole || !origin.reference) return origin;
  // Only what the run has seen counts for its coverage.
  const auto first = sequence->next();
  if (!first) fail_input("{}: dataset: nothing is left of it in this span", resolved.string());
  const Stamp from = stamp_of(*first);
  const Stamp to =
      dataset.duration_s > 0.0 ? from + Duration::from_seconds(dataset.duration_s) : Stamp::max();
  origin.reference = eval::within(*origin.reference, from, to);
  return origin;
}

Origin origin_of(const Arguments& a) {
  if (a.reference.empty()) return open_origin(a.run);
  Origin origin;
  origin.reference = io::read_trajectory(a.reference);
  if (a.estimate_world || origin.reference->has_rotation) return origin;
  try {
    origin.world = open_origin(a.run).world;
  } catch (const InputError& e) {
    log::warning("{}; taking the run's world as z up, --estimate-world ned says otherwise",
                 e.what());
  }
  return origin;
}

eval::TrajectoryMetrics metrics_of(const Trajectory& estimate, const Arguments& a,
                                   const Origin& origin) {
  if (!origin.reference) return eval::evaluate_alone(estimate);
  return eval::evaluate(*origin.reference, estimate,
                        options_for(a, *origin.reference, origin.world));
}

std::optional<eval::TrajectoryMetrics> metrics_of_part(const fs::path& file, const Arguments& a,
                                                       const Origin& origin) {
  if (!fs::exists(file)) return std::nullopt;
  try {
    return metrics_of(io::read_trajectory(file), a, origin);
  } catch (const InputError& e) {
    log::warning("{}; left out", e.what());  // an estimator that never started leaves an empty file
    return std::nullopt;
  }
}

void eval_run(const Arguments& a) {
  if (!fs::is_directory(a.run)) fail_input("{}: no such folder", a.run.string());
  const fs::path file = a.run / "trajectory.tum";
  const Trajectory fused = io::read_trajectory(file);
  const Origin origin = origin_of(a);
  if (!origin.reference) log::warning("the data set has no reference; only closure can be told");
  const eval::RunTrajectories metrics{.fused = metrics_of(fused, a, origin),
                                      .dipo = metrics_of_part(a.run / "dipo.tum", a, origin),
                                      .vio = metrics_of_part(a.run / "vio.tum", a, origin)};
  if (origin.reference) {
    check_matched(metrics.fused, *origin.reference, fused,
                  options_for(a, *origin.reference, origin.world), file.string());
  }
  const fs::path metrics_file = a.run / "metrics.json";
  eval::merge_metrics(metrics_file, {{"trajectory", eval::to_json(metrics)}});
  print(a.json ? eval::read_metrics(metrics_file).dump(2) + "\n" : eval::to_table(metrics));
}

}  // namespace

void add_eval(CLI::App& app) {
  const auto arguments = std::make_shared<Arguments>();
  Arguments& a = *arguments;
  CLI::App* run = app.add_subcommand(
      "eval", "metrics of a run, written to its metrics.json; or of any two trajectories");
  run->add_option("RUN", a.run, "run folder");
  run->add_option("--reference", a.reference,
                  "trajectory file instead of the data set's reference");
  add_options(*run, a);
  CLI::App* pair = run->add_subcommand("trajectory", "one trajectory file against another");
  pair->add_option("--reference", a.reference, "TUM, EuRoC csv or gnss0/data.csv")->required();
  pair->add_option("--estimate", a.estimate, "the same")->required();
  add_options(*pair, a);
  pair->callback([arguments] { eval_pair(*arguments); });
  run->callback([arguments, pair] {
    if (pair->parsed()) return;
    if (arguments->run.empty()) throw CLI::RequiredError("RUN");
    eval_run(*arguments);
  });
}

}  // namespace apvi::apps
