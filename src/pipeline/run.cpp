// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/pipeline/run.hpp"

#include <sys/resource.h>

#include <nlohmann/json.hpp>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/core/progress.hpp"
#include "apvi/core/stopwatch.hpp"
#include "apvi/eval/metrics_file.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/pipeline/run_folder.hpp"
#include "apvi/version.hpp"

namespace apvi::pipeline {
namespace {

namespace fs = std::filesystem;

// Paths in a resolved configuration hold wherever the program is started from.
void write_resolved(const RunConfig& config, const config::Node& rig, const fs::path& file) {
  RunConfig resolved = config;
  resolved.dataset.path = fs::absolute(config.dataset.path).lexically_normal().string();
  resolved.dataset.rig.clear();  // its content is in `rig`
  resolved.rig = rig;
  io::write_text_file(file, config::to_yaml(config::to_node(resolved)));
}

double peak_memory_mib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

std::size_t total_dropped(const io::StreamReport& report) {
  std::size_t sum = 0;
  for (const auto& [reason, count] : report.dropped) sum += count;
  return sum;
}

eval::Json counts_json(const Localization& localization, const io::SequenceReader& reader) {
  eval::Json json = eval::Json::object();
  for (const auto& [verdict, count] : localization.counts().pings) {
    json["dvl"][std::string(dipo::to_string(verdict))] = count;
  }
  for (const auto& [verdict, count] : localization.counts().depths) {
    json["depth"][std::string(dipo::to_string(verdict))] = count;
  }
  json["imu_gaps"] = localization.dipo().gaps();
  json["imu_saturated"] = localization.dipo().saturated_samples();
  json["zero_velocity_updates"] = localization.dipo().zero_velocity_updates();
  for (const auto& [sensor, report] : reader.report()) {
    json["dropped_samples"][sensor] = total_dropped(report);
  }
  return json;
}

eval::Json speed_json(const RunResult& result) {
  eval::Json json{{"wall_s", result.wall_s},
                  {"sequence_s", result.sequence_s},
                  {"rss_peak_mib", peak_memory_mib()}};
  if (result.wall_s > 0.0) json["realtime_factor"] = result.sequence_s / result.wall_s;
  return json;
}

eval::TrajectoryMetrics evaluate(const RunConfig& config, const Rig& rig,
                                 const io::SequenceReader& reader, std::optional<Stamp> first,
                                 const Trajectory& estimate) {
  auto reference = reader.reference();
  if (!reference || estimate.empty()) return eval::evaluate_alone(estimate);
  const bool whole = config.dataset.start_s == 0.0 && config.dataset.duration_s == 0.0;
  if (!whole && first) reference = eval::seen_part(*reference, *first, config.dataset.duration_s);
  eval::EvalOptions options = config.eval;
  options.estimate_world = rig.world;
  options.reference_world = eval::reference_world(*reference, rig.world);
  return eval::evaluate(*reference, estimate, options);
}

// What one pass over the recording leaves behind.
struct Pass {
  Trajectory trajectory;
  double length_m = 0.0;
  double accel_factor = 1.0;  // what the adaptive noise ended with
  std::optional<Stamp> first;
  Stamp last;
  bool interrupted = false;
};

std::string status_detail(const Localization& localization, const Pass& pass) {
  if (!localization.dipo().initialized()) {
    return "waiting for " + localization.dipo().waiting_for();
  }
  return fmt::format("{} poses, {:.1f} m", pass.trajectory.size(), pass.length_m);
}

void add_pose(Pass& pass, const dipo::Estimate& estimate) {
  const imu::NavState& nav = estimate.state.nav;
  std::vector<StampedPose>& poses = pass.trajectory.poses;
  if (!poses.empty()) {
    pass.length_m += (nav.p_world - poses.back().T_world_body.translation).norm();
  }
  poses.push_back({estimate.stamp, {nav.R_world_body, nav.p_world}});
}

Pass localize(io::SequenceReader& reader, Localization& localization, RunFolder& folder,
              const std::function<bool()>& interrupted) {
  Pass pass;
  StatusLine status("localizing");
  std::size_t count = 0;
  while (const auto event = reader.next()) {
    pass.last = stamp_of(*event);
    if (!pass.first) pass.first = pass.last;
    for (const LocalizationOutput& output : localization.process(*event)) {
      folder.write(output);
      add_pose(pass, output.estimate);
      pass.accel_factor = output.ping.accel_factor;
    }
    if (++count % 1024 == 0) status.update(reader.fraction(), status_detail(localization, pass));
    if (interrupted()) {
      pass.interrupted = true;
      break;
    }
  }
  return pass;
}

// Innovations that the largest accelerometer noise does not explain have another cause.
void warn_if_sensors_disagree(const RunConfig& config, const Pass& pass) {
  if (pass.accel_factor < 0.5 * config.dipo.adaptation.max_accel_factor) return;
  log::warning(
      "DVL and IMU disagree to the end: look at the DVL's mounting and axes with `apvi doctor`, "
      "and "
      "at dipo.initialization.gyro_bias_sigma (MEMS gyros may need 0.1)");
}

}  // namespace

RunResult run(const RunConfig& config, const RunOptions& options) {
  if (config.dataset.path.empty()) {
    fail_input("dataset.path: not given; add --set dataset.path=FOLDER");
  }
  const auto reader = io::open_sequence(config.dataset, config.sensors.use);
  const config::Node rig_node = rig_of(config, reader->rig());
  const Rig rig = make_rig(rig_node);
  Localization localization(config.dipo, rig);
  RunFolder folder(options.folder, options.overwrite);
  log::open_file(folder.file("log.txt"));
  write_resolved(config, rig_node, folder.file("resolved.yaml"));
  log::info("{} -> {}", config.dataset.path, folder.path().string());

  const Stopwatch watch;
  const Pass pass = localize(*reader, localization, folder, options.interrupted);
  folder.close();
  warn_if_sensors_disagree(config, pass);
  RunResult result{.interrupted = pass.interrupted,
                   .poses = pass.trajectory.size(),
                   .sequence_s = pass.first ? seconds_between(*pass.first, pass.last) : 0.0,
                   .wall_s = watch.seconds(),
                   .metrics = evaluate(config, rig, *reader, pass.first, pass.trajectory)};
  const eval::RunTrajectories metrics{.fused = result.metrics, .dipo = result.metrics, .vio = {}};
  eval::merge_metrics(folder.file("metrics.json"),
                      {{"trajectory", eval::to_json(metrics)},
                       {"counts", counts_json(localization, *reader)},
                       {"speed", speed_json(result)},
                       {"build", {{"backend", kBackend}, {"git", kGitRevision}}}});
  if (result.poses == 0 && !result.interrupted) {
    fail_run("{}: no pose was estimated: waited for {} to the end; `apvi doctor` says more",
             config.dataset.path, localization.dipo().waiting_for());
  }
  return result;
}

}  // namespace apvi::pipeline
