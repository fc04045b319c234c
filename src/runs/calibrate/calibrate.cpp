// SPDX-License-Identifier: BSD-3-Clause
#include "runs/calibrate/calibrate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <set>
#include <sstream>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "config/renamed_keys.hpp"
#include "core/fingerprint.hpp"
#include "runs/calibrate/calibrate_files.hpp"
#include "runs/health_file.hpp"
#include "runs/run.hpp"
#include "vio/estimator.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using fusion::Normalization;

// Focal length of the thresholds; eigenvalues of other cameras are scaled to it.
constexpr double kFocalPx = fusion::DegeneracyCheckConfig{}.reference_focal_px;

// Long enough for the window to lose its landmarks, and to reinitialize in between.
constexpr double kBlackout_s = 10.0;
constexpr double kVisible_s = 15.0;

std::string read_text(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) fail_input("{}: cannot be read", file.string());
  return (std::ostringstream() << in.rdbuf()).str();
}

RunConfig resolved_config(const fs::path& run) {
  RunConfig config;
  config::read(config::load_recorded_config(run / "resolved.yaml", config::run_renames()), config);
  return config;
}

std::string fingerprint_of(const fs::path& run) {
  RunConfig config = resolved_config(run);
  config.dataset.path.clear();
  const std::string text = config::to_yaml(config::to_node(config)) + read_text(run / "health.csv");
  return fmt::format("{:016x}", fingerprint(text));
}

// Factor that scales a run's eigenvalues to a camera of focal length kFocalPx.
double focal_scale(const RunConfig& config) {
  if (config.rig.find("cam0") == nullptr) return 1.0;
  const double ratio = kFocalPx / make_rig(config.rig).cameras.front().model.parameters().fx;
  return ratio * ratio;
}

// Name of the last path component, with or without a trailing slash.
std::string name_of(const fs::path& path) {
  const fs::path plain = fs::absolute(path).lexically_normal();
  return (plain.has_filename() ? plain : plain.parent_path()).stem().string();
}

RunConfig load_calibration_config(const fs::path& recording, const CalibrateOptions& options) {
  if (options.config.empty()) {
    fail_input("{}: is not a run folder; a recording needs a configuration: use --config",
               recording.string());
  }
  std::vector<std::string> overrides = options.overrides;
  overrides.push_back("dataset.path=" + recording.string());
  overrides.emplace_back("vio.graph=paper");
  overrides.emplace_back("fusion.discriminator.degeneracy.action=ignore");
  return load_run_config(options.config, overrides, options.search);
}

RunResult run_or_fail(const RunConfig& config, const fs::path& folder,
                      const CalibrateOptions& options) {
  RunResult result =
      run(config,
          {.folder = folder, .overwrite = options.overwrite, .interrupted = options.interrupted});
  if (result.interrupted) fail_run("interrupted; the runs so far are in {}", folder.string());
  return result;
}

// Runs the recording with camera and IMU only, with periodic blackouts.
fs::path run_with_blackouts(RunConfig config, double sequence_s, const fs::path& folder,
                            const CalibrateOptions& options) {
  config.sensors.use = {"camera", "imu"};
  config.dataset.blackout_s.clear();
  for (double t = kVisible_s; t + kBlackout_s < sequence_s; t += kVisible_s + kBlackout_s) {
    config.dataset.blackout_s.push_back({t, t + kBlackout_s});
  }
  run_or_fail(config, folder, options);
  return folder;
}

CalibrationRun run_recording(const fs::path& recording, const std::string& name,
                             const CalibrateOptions& options) {
  const RunConfig config = load_calibration_config(recording, options);
  const fs::path folder = options.folder / "runs" / name;
  const RunResult result = run_or_fail(config, folder, options);
  CalibrationRun run{name, fingerprint_of(folder), recorded_frames(folder), {}, {}};
  const fs::path dark = options.folder / "runs" / (name + "-dark");
  run.frames.blind =
      recorded_frames(run_with_blackouts(config, result.sequence_s, dark, options)).blind;
  return run;
}

CalibrationRun load_run(const fs::path& folder, const std::string& name) {
  if (resolved_config(folder).vio.graph != vio::GraphKind::paper) {
    log::warning(
        "{}: has DVL and pressure factors in its graph, which its thresholds include; use runs "
        "with vio.graph: paper",
        folder.string());
  }
  return {name, fingerprint_of(folder), recorded_frames(folder), {}, {}};
}

fusion::RecordedFrames all_frames(const std::vector<CalibrationRun>& runs) {
  fusion::RecordedFrames all;
  for (const CalibrationRun& run : runs) {
    all.healthy.insert(all.healthy.end(), run.frames.healthy.begin(), run.frames.healthy.end());
    all.blind.insert(all.blind.end(), run.frames.blind.begin(), run.frames.blind.end());
  }
  return all;
}

std::vector<CalibrationRun> collect_runs(const CalibrateOptions& options) {
  std::vector<CalibrationRun> runs;
  std::set<std::string> names;
  for (const fs::path& input : options.inputs) {
    std::string name = name_of(input);
    for (int i = 2; !names.insert(name).second; ++i) name = fmt::format("{}-{}", name_of(input), i);
    const bool finished = fs::exists(input / "health.csv") && fs::exists(input / "resolved.yaml");
    runs.push_back(finished ? load_run(input, name) : run_recording(input, name, options));
    if (runs.back().frames.healthy.empty()) {
      fail_run("{}: no frame with healthy VIO; see its health.csv", input.string());
    }
  }
  return runs;
}

}  // namespace

fusion::RecordedFrames recorded_frames(const fs::path& run) {
  const RunConfig config = resolved_config(run);
  const bool divided =
      config.fusion.discriminator.degeneracy.normalization == Normalization::per_inlier;
  const double scale = focal_scale(config);
  fusion::RecordedFrames frames;
  for (const HealthRow& line : read_health(run / "health.csv")) {
    fusion::RecordedFrame frame{line.eigenvalues, line.landmarks};
    const double factor = scale * (divided ? std::max(1, line.landmarks) : 1);
    frame.eigenvalues = {factor * line.eigenvalues.rotation, factor * line.eigenvalues.position};
    const bool passed = line.level == "accepted" || line.level == "fine";
    if (passed && line.vio == vio::to_string(vio::Status::tracking))
      frames.healthy.push_back(frame);
    if (line.vio == vio::to_string(vio::Status::blind)) frames.blind.push_back(frame);
  }
  return frames;
}

CalibrationResult calibrate(const CalibrateOptions& options) {
  if (options.inputs.empty()) fail_input("no input: name recordings or run folders");
  CalibrationResult result;
  result.runs = collect_runs(options);
  result.normalization = options.normalization;
  const fusion::RecordedFrames frames = all_frames(result.runs);
  const auto fit = [&](Normalization normalization) {
    const auto found = fusion::calibrate_degeneracy(frames, normalization, options.max_false_alarm,
                                                    result.min_directions);
    if (!found)
      fail_run("the healthy frames all have the same eigenvalues; cannot fit a distribution");
    return *found;
  };
  result.plain = fit(Normalization::none);
  result.per_inlier = fit(Normalization::per_inlier);
  for (CalibrationRun& run : result.runs) {
    const auto evaluate = [&](const std::vector<fusion::RecordedFrame>& of) {
      return fusion::evaluate_thresholds(of, result.chosen().thresholds, result.normalization,
                                         result.min_directions);
    };
    run.healthy = evaluate(run.frames.healthy);
    run.blind = evaluate(run.frames.blind);
  }
  fs::create_directories(options.folder);
  io::write_text_file(options.folder / "thresholds.yaml", to_yaml(result));
  io::write_text_file(options.folder / "eigenvalues.csv", internal::eigenvalues_csv(result));
  io::write_text_file(options.folder / "calibration.json", internal::calibration_json(result));
  return result;
}

}  // namespace apvi::runs
