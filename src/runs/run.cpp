// SPDX-License-Identifier: BSD-3-Clause
#include "runs/run.hpp"

#include <algorithm>
#include <mutex>
#include <nlohmann/json.hpp>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/sensors/central_fit.hpp"
#include "apvi/version.hpp"
#include "core/median.hpp"
#include "core/memory.hpp"
#include "core/status_line.hpp"
#include "core/stopwatch.hpp"
#include "eval/metrics_file.hpp"
#include "localization/map_sink.hpp"
#include "localization/pipeline.hpp"
#include "localization/sensor_monitor.hpp"
#include "localization/synchronizer.hpp"
#include "localization/visual_pipeline.hpp"
#include "runs/calibrate/found_calibration.hpp"
#include "runs/calibrate/self_calibration.hpp"
#include "runs/dive_files.hpp"
#include "runs/playback_clock.hpp"
#include "runs/relocalization.hpp"
#include "runs/run_folder.hpp"
#include "runs/scale.hpp"
#include "runs/smoothed.hpp"
#include "runs/warnings.hpp"

namespace apvi::runs {
namespace {

std::size_t total_dropped(const io::StreamReport& report) {
  std::size_t sum = 0;
  for (const auto& [reason, count] : report.dropped) sum += count;
  return sum;
}

eval::Json counts_json(const localization::Pipeline& pipeline, const io::SequenceReader& reader) {
  const localization::Synchronizer& synchronizer = pipeline.synchronizer();
  eval::Json json = eval::Json::object();
  for (const localization::Outage& outage : pipeline.sensor_monitor().outages()) {
    eval::Json& count = json["outages"][outage.sensor];
    count = count.is_null() ? 1 : count.get<int>() + 1;
  }
  for (const auto& [sensor, report] : reader.report()) {
    json["dropped_samples"][sensor] = total_dropped(report);
  }
  json["abandoned_frames"] = synchronizer.abandoned_frames();
  if (!synchronizer.has_acoustic_odometry()) return json;
  const localization::AcousticOdometry& acoustic_odometry = synchronizer.acoustic_odometry();
  for (const auto& [verdict, count] : acoustic_odometry.counts().pings) {
    json["dvl"][std::string(dipo::to_string(verdict))] = count;
  }
  for (const auto& [verdict, count] : acoustic_odometry.counts().depths) {
    json["depth"][std::string(dipo::to_string(verdict))] = count;
  }
  json["imu_gaps"] = acoustic_odometry.dipo().gaps();
  json["imu_saturated"] = acoustic_odometry.dipo().saturated_samples();
  json["zero_velocity_updates"] = acoustic_odometry.dipo().zero_velocity_updates();
  return json;
}

eval::Json speed_json(const RunResult& result) {
  eval::Json json{{"wall_s", result.wall_s},
                  {"sequence_s", result.sequence_s},
                  {"rss_peak_mib", peak_memory_mib()}};
  if (result.wall_s > 0.0) json["realtime_factor"] = result.sequence_s / result.wall_s;
  return json;
}

// Empty when the recording has no reference.
std::optional<Trajectory> reference_of(const RunConfig& config, const io::SequenceReader& reader,
                                       std::optional<Stamp> first) {
  auto reference = reader.reference();
  const bool whole = config.dataset.start_s == 0.0 && config.dataset.duration_s == 0.0;
  if (!reference || whole || !first) return reference;
  return eval::clip_to_run(*reference, *first, config.dataset.duration_s);
}

eval::TrajectoryMetrics evaluate(const RunConfig& config, const Rig& rig,
                                 const std::optional<Trajectory>& reference,
                                 const Trajectory& estimate, bool scale_is_known) {
  if (!reference || estimate.empty()) return eval::evaluate_without_reference(estimate);
  eval::EvalOptions options = config.eval;
  const bool rigid = options.alignment == eval::Alignment::se3;
  if (rigid && !scale_is_known) options.alignment = eval::Alignment::sim3;
  options.estimate_world = rig.world;
  options.reference_world = eval::reference_world(*reference, rig.world);
  return eval::evaluate(*reference, estimate, options);
}

// Results of one pass over the recording.
struct Pass {
  Trajectory fused;
  Trajectory smoothed;  // empty if the trajectory is not smoothed
  Trajectory dipo;
  Trajectory vio;
  double length_m = 0.0;
  double accel_factor = 1.0;  // final value of the adaptive noise
  std::optional<DvlTimeOffset> dvl_time_offset;
  std::vector<double> frame_s;  // tracking and estimation time per frame
  SampleStatistics samples;
  VioService vio_service;
  std::optional<localization::ScaleSensor> scale_by;  // of poses by images alone
  std::optional<Stamp> first;
  Stamp last;
  bool interrupted = false;
};

StampedPose stamped(Stamp stamp, const imu::NavState& nav) {
  return {stamp, nav.pose()};
}

void add_pose(Pass& pass, const StampedPose& pose) {
  std::vector<StampedPose>& poses = pass.fused.poses;
  if (!poses.empty()) {
    const Eigen::Vector3d& before = poses.back().T_world_body.translation;
    pass.length_m += (pose.T_world_body.translation - before).norm();
  }
  poses.push_back(pose);
}

/// One run over a recording: feeds the pipeline, writes the run's files and collects the results
/// for the evaluation.
class Runner {
 public:
  Runner(const RunConfig& config, const Rig& rig, const localization::ActiveSensors& sensors,
         RunFolder& folder, const RunOptions& options)
      : config_(config),
        map_(sensors.cameras > 0 ? options.map : nullptr),
        live_(options.live),
        observer_(options.observer),
        folder_(folder),
        pipeline_(localization_options(config), rig, sensors,
                  {.pose = {},
                   .ping = [this](const localization::PingOutput& o) { record(o); },
                   .frame = [this](const localization::FrameOutput& o) { record(o); },
                   .map = map_}) {
    pass_.samples = SampleStatistics(config.dipo.inertial.segment_gap_s);
    if (config.run.mode != localization::RunMode::realtime || live_ != nullptr) return;
    playback_.emplace(config.run.playback_rate, config.dipo.inertial.segment_gap_s);
  }

  Pass run(io::SequenceReader& reader, const std::function<bool()>& interrupted) {
    try {
      localize(reader, interrupted);
      write_ends();  // of the graph, should the program end during the adjustment
      adjust();
    } catch (...) {
      pipeline_.stop();
      write_ends();
      throw;
    }
    write_ends();
    if (map_ != nullptr) map_->finish();
    return std::move(pass_);
  }

  const localization::Pipeline& pipeline() const { return pipeline_; }

 private:
  void localize(io::SequenceReader& reader, const std::function<bool()>& interrupted) {
    StatusLine status("localizing");
    std::size_t count = 0;
    if (live_ != nullptr) live_->begin();
    while (const auto event = reader.next()) {
      pass_.last = stamp_of(*event);
      if (!pass_.first) pass_.first = pass_.last;
      pass_.samples.add(*event);
      spans_.add(*event);
      if (observer_ != nullptr) observer_->sample(*event);
      if (playback_) playback_->wait(pass_.last, interrupted);
      pipeline_.process(*event);
      if (++count % 256 == 0) status.update(live_ == nullptr ? reader.fraction() : -1.0, detail());
      if (interrupted()) {
        pass_.interrupted = true;
        break;
      }
    }
    if (live_ != nullptr && interrupted()) pass_.interrupted = true;  // ended the sequence
    pipeline_.finish();
  }

  void adjust() {
    StatusLine status("adjusting the trajectory");
    pipeline_.adjust(
        [&](int iteration) { status.update(-1.0, fmt::format("iteration {}", iteration)); });
  }

  // Once the pipeline has ended, with what the graph knows then.
  void write_ends() {
    write_sensor_spans(folder_.file(kSensorsFile), spans_.all());
    const localization::VisualPipeline* visual = pipeline_.visual();
    if (visual == nullptr || visual->smoother() == nullptr || pass_.fused.empty()) return;
    pass_.smoothed = visual->smoother()->smoothed(pass_.fused);
    io::write_tum(folder_.file(kSmoothedFile), pass_.smoothed);
    loop_closure::save(visual->smoother()->closer().place_map(),
                       folder_.file(loop_closure::kPlacesFile));
    write_loops(folder_.file(kLoopsFile), visual->smoother()->closer().loops());
  }

  void record(const localization::PingOutput& output) {
    folder_.write(output);
    const StampedPose pose = stamped(output.estimate.stamp, output.estimate.state.nav);
    pass_.dipo.poses.push_back(pose);
    if (pipeline_.visual() == nullptr) {
      add_pose(pass_, pose);
      if (live_ != nullptr) live_->ping(output);
      if (observer_ != nullptr) observer_->ping(output);
    }
    pass_.accel_factor = output.ping.accel_factor;
    const double variance = output.estimate.covariance(dipo::kTimeOffset, dipo::kTimeOffset);
    pass_.dvl_time_offset = {output.estimate.state.dvl_time_offset_s, std::sqrt(variance)};
  }

  // Called from the last stage's thread; the status line reads the guarded members.
  void record(const localization::FrameOutput& output) {
    if (live_ != nullptr) live_->frame(output);
    if (observer_ != nullptr) observer_->frame(output);
    folder_.write(output);
    const std::scoped_lock lock(mutex_);
    if (output.scale_found) apply(*output.scale_found);
    pass_.fused.merge(output.vio.earlier);
    pass_.vio.merge(output.vio.earlier);
    if (!output.vio.earlier.empty()) pass_.length_m = pass_.fused.path_length();
    if (const auto pose = output.fused()) add_pose(pass_, *pose);
    if (output.vio.has_state()) pass_.vio.poses.push_back(stamped(output.stamp, output.vio.state));
    count(output);
    if (!output.dropped) {
      pass_.frame_s.push_back(output.timing.track_s + output.timing.localize_s);
    }
    awaited_ = output.fused() ? "" : output.vio.detail;
  }

  void apply(const localization::ScaleFound& found) {
    localization::apply(found, pass_.fused);
    localization::apply(found, pass_.vio);
    pass_.vio_service.up_to_scale = 0;
    pass_.scale_by = found.by;
  }

  void count(const localization::FrameOutput& output) {
    VioService& service = pass_.vio_service;
    ++service.frames;
    service.add_image(output.statistics);
    if (output.vio.has_state()) ++service.with_pose;
    if (output.vio.has_state() && output.vio.up_to_scale) ++service.up_to_scale;
    if (!output.vio.has_state() || output.vio.up_to_scale) service.waiting_for = output.vio.detail;
    const fusion::FusionState state = output.fusion.state;
    const bool used = state == fusion::FusionState::fused || state == fusion::FusionState::vio_only;
    if (used) ++service.used;
  }

  std::string detail() {
    return live_ == nullptr ? progress() : progress() + ", " + live_->status();
  }

  std::string progress() {
    const std::scoped_lock lock(mutex_);
    if (!pass_.fused.empty()) {
      const std::string map = map_ == nullptr ? "" : ", " + map_->status();
      const char* unit = has_unknown_scale(pass_.vio_service) ? "units, up to scale" : "m";
      return fmt::format("{} poses, {:.1f} {}{}", pass_.fused.size(), pass_.length_m, unit, map);
    }
    const localization::Synchronizer& synchronizer = pipeline_.synchronizer();
    if (synchronizer.has_acoustic_odometry() &&
        !synchronizer.acoustic_odometry().dipo().initialized()) {
      return "waiting for " + synchronizer.acoustic_odometry().dipo().waiting_for();
    }
    return "waiting for " + awaited_;
  }

  const RunConfig& config_;
  localization::MapSink* map_;
  const LiveHooks* live_;
  RunObserver* observer_;
  RunFolder& folder_;
  std::optional<PlaybackClock> playback_;
  std::mutex mutex_;
  Pass pass_;
  SensorSpans spans_;
  std::string awaited_ = "the camera";
  localization::Pipeline pipeline_;  // last member: its threads use the others
};

// Success: VIO contributed and recovered from every failure. Its other figures would be untrue when
// it never contributed.
eval::Json vio_json(const localization::VisualPipeline& visual, const Evidence& evidence) {
  if (!vio_served(evidence)) return {{"success", false}};
  const fusion::FreezePolicy& policy = visual.fusion_stage().freeze_policy();
  eval::Json json{{"failures", policy.counts().failures},
                  {"freeze_frames", policy.counts().freeze_frames},
                  {"drop_frames", policy.counts().drop_frames},
                  {"resets", policy.counts().resets},
                  {"reinit_times_s", policy.reinit_times()},
                  {"success", policy.recovered()}};
  if (const auto start = visual.fusion_stage().vio_init_time_s()) json["init_time_s"] = *start;
  return json;
}

AcousticService acoustic_service(const RunConfig& config,
                                 const localization::AcousticOdometry& odometry, const Pass& pass) {
  return {.counts = odometry.counts(),
          .waiting_for = odometry.dipo().waiting_for(),
          .saturated_imu = odometry.dipo().saturated_samples(),
          .accel_factor = pass.accel_factor,
          .max_accel_factor = config.dipo.adaptation.max_accel_factor};
}

Evidence evidence_of(const RunConfig& config, const io::SequenceReader& reader,
                     const localization::Pipeline& pipeline, const Pass& pass) {
  Evidence evidence{.sensors_in_use = config.sensors.use,
                    .streams = reader.report(),
                    .images = {},
                    .vio = std::nullopt,
                    .acoustic = std::nullopt,
                    .samples = pass.samples,
                    .gravity = config.localization.gravity};
  if (const localization::VisualPipeline* visual = pipeline.visual()) {
    evidence.images = visual->image_counts();
    evidence.vio = pass.vio_service;
  }
  const localization::Synchronizer& synchronizer = pipeline.synchronizer();
  if (synchronizer.has_acoustic_odometry()) {
    evidence.acoustic = acoustic_service(config, synchronizer.acoustic_odometry(), pass);
  }
  return evidence;
}

std::vector<std::string> collect_warnings(const Evidence& evidence, const Rig& rig,
                                          const Trajectory& fused) {
  std::vector<std::string> warnings = check_inputs(evidence, rig);
  for (std::string& warning : check_result(evidence, fused)) warnings.push_back(std::move(warning));
  const auto is_said = [&](const std::string& warning) {
    return std::ranges::any_of(evidence.streams, [&](const auto& stream) {
      return stream.second.remark == warning;  // when the recording was opened
    });
  };
  for (const std::string& warning : warnings) {
    if (!is_said(warning)) log::warning("{}", warning);
  }
  return warnings;
}

// Images that were skipped, if any.
eval::Json image_counts_json(const Evidence& evidence) {
  eval::Json json = eval::Json::object();
  for (std::size_t i = 0; i < evidence.images.size(); ++i) {
    const localization::ImageCounts& counts = evidence.images[i];
    if (counts.unusable() == 0) continue;
    json[fmt::format("cam{}", i)] = {{"images", counts.images},
                                     {"undecodable", counts.undecodable},
                                     {"wrong_size", counts.wrong_size}};
    log::warning("cam{}: {} of {} images were skipped: {} not decodable, {} of the wrong size", i,
                 counts.unusable(), counts.images, counts.undecodable, counts.wrong_size);
  }
  return json;
}

std::string awaited(const localization::Synchronizer& synchronizer, const VioService& vio) {
  if (!synchronizer.has_acoustic_odometry())
    return vio.waiting_for.empty() ? "images" : vio.waiting_for;
  return synchronizer.acoustic_odometry().dipo().waiting_for();
}

eval::RunTrajectories evaluate_against(const std::optional<Trajectory>& reference,
                                       const RunConfig& config, const Rig& rig, const Pass& pass,
                                       const Evidence& evidence) {
  eval::RunTrajectories metrics;
  metrics.in_meters = !has_unknown_scale(evidence);
  const auto metrics_of = [&](const Trajectory& estimate) {
    return evaluate(config, rig, reference, estimate, metrics.in_meters);
  };
  metrics.fused = metrics_of(pass.fused);
  if (dipo_served(evidence)) metrics.dipo = metrics_of(pass.dipo);
  if (vio_served(evidence)) metrics.vio = metrics_of(pass.vio);
  if (!pass.smoothed.empty()) metrics.smoothed = metrics_of(pass.smoothed);
  return metrics;
}

// A reference is optional: whatever is wrong with it, the results of the run are kept.
eval::RunTrajectories evaluate(const RunConfig& config, const Rig& rig,
                               const io::SequenceReader& reader, const Pass& pass,
                               const Evidence& evidence) {
  try {
    return evaluate_against(reference_of(config, reader, pass.first), config, rig, pass, evidence);
  } catch (const std::exception& e) {
    log::warning("no evaluation against the reference: {}", e.what());
    return evaluate_against(std::nullopt, config, rig, pass, evidence);
  }
}

eval::Json scale_section(ScaleSource expected, const localization::ActiveSensors& sensors,
                         const Pass& pass, const Evidence& evidence) {
  ScaleSource source = pass.scale_by ? source_of(*pass.scale_by) : expected;
  if (evidence.acoustic && !dipo_served(evidence)) source = ScaleSource::accelerometer;
  if (has_unknown_scale(evidence)) source = ScaleSource::images;
  eval::Json json = scale_json(source);
  json["vertical"] = sensors.imu ? "accelerometer" : "assumed";
  return json;
}

// Without pauses of all sensors, which may be a clock that was set.
double sequence_s(const Pass& pass) {
  if (!pass.first) return 0.0;
  return seconds_between(*pass.first, pass.last) - pass.samples.silent_s();
}

void log_ports(const Rig& rig) {
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    if (rig.cameras[i].port) log::info("cam{}: {}", i, port_summary(rig.cameras[i]));
  }
}

}  // namespace

RunResult run(const RunConfig& config, const RunOptions& options) {
  const auto reader = io::open_sequence(config.dataset, config.sensors.use);
  return run(config, *reader, options);
}

RunResult run(const RunConfig& config, io::SequenceReader& reader, const RunOptions& options) {
  const config::Node rig_node = runs::resolve_rig(config, reader.rig());
  const Rig rig = make_rig(rig_node);
  const auto& streams = reader.report();
  const localization::ActiveSensors sensors = localization::select_sensors(
      localization_options(config), rig,
      {.images = streams.contains("camera"), .imu = streams.contains("imu")});
  if (options.map != nullptr && sensors.cameras == 0) {
    fail_input("{}: no images of cam0; mapping requires them", config.dataset.path);
  }
  check_known_map(config, sensors, options.folder);
  RunFolder folder(options.folder, {.overwrite = options.overwrite, .camera = sensors.cameras > 0});
  log::open_file(folder.file("log.txt"));
  const RunConfig effective_config = resolved(config, rig_node);
  io::write_text_file(folder.file("resolved.yaml"),
                      config::to_yaml(config::to_node(effective_config)));
  log::info("{} -> {}", config.dataset.path, folder.path().string());
  const ScaleSource scale = scale_of(rig, sensors);
  warn_about_scale(scale);
  log_ports(rig);
  if (options.observer != nullptr) options.observer->begin(rig);
  options.folder_ready();

  const Stopwatch watch;
  Runner runner(config, rig, sensors, folder, options);
  const Pass pass = runner.run(reader, options.interrupted);
  const localization::Pipeline& pipeline = runner.pipeline();
  folder.close();
  const Evidence evidence = evidence_of(config, reader, pipeline, pass);
  eval::Json counts = counts_json(pipeline, reader);
  if (auto images = image_counts_json(evidence); !images.empty()) counts["images"] = images;
  RunResult result{.interrupted = pass.interrupted,
                   .poses = pass.fused.size(),
                   .sequence_s = sequence_s(pass),
                   .wall_s = watch.seconds(),
                   .metrics = evaluate(config, rig, reader, pass, evidence),
                   .warnings = collect_warnings(evidence, rig, pass.fused)};
  const eval::Json relocalization =
      report_relocalization(config, pipeline.visual(), pass.first, result.warnings);
  if (result.metrics.smoothed) {
    warn_about_breaks(*pipeline.visual()->smoother(), result.warnings);
  }
  eval::Json speed = speed_json(result);
  if (!pass.frame_s.empty()) speed["tracking_fps"] = 1.0 / median(pass.frame_s);
  eval::Json sections{{"trajectory", eval::to_json(result.metrics)},
                      {"warnings", result.warnings},
                      {"scale", scale_section(scale, sensors, pass, evidence)},
                      {"counts", counts},
                      {"speed", speed},
                      {"build", {{"backend", kBackend}, {"git", kGitRevision}}}};
  if (const localization::VisualPipeline* visual = pipeline.visual()) {
    sections["vio"] = vio_json(*visual, evidence);
    result.calibration = found_calibration(config, rig, *visual, pass.dvl_time_offset);
    eval::Json calibration = report_self_calibration(folder.file("rig_estimated.yaml"), rig_node,
                                                     result.calibration.parameters);
    if (!calibration.empty()) sections["self_calibration"] = std::move(calibration);
    sections["dropped"]["images"] = visual->dropped_images();
    if (!relocalization.empty()) sections["relocalization"] = relocalization;
    if (result.metrics.smoothed) {
      sections["smoothed"] =
          smoothed_json(*visual->smoother(), pass.fused, pass.smoothed, *result.metrics.smoothed);
    }
  }
  eval::merge_metrics(folder.file("metrics.json"), sections);
  if (result.poses == 0 && !result.interrupted) {
    fail_run("{}: no pose was estimated: still waiting for {} at the end; run `apvi doctor`",
             config.dataset.path, awaited(pipeline.synchronizer(), pass.vio_service));
  }
  return result;
}

}  // namespace apvi::runs
