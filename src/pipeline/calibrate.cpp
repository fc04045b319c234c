// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/pipeline/calibrate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <set>
#include <sstream>

#include "apvi/core/error.hpp"
#include "apvi/core/fingerprint.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/pipeline/health_file.hpp"
#include "apvi/pipeline/run.hpp"
#include "apvi/vio/estimator.hpp"
#include "calibrate_files.hpp"

namespace apvi::pipeline {
namespace {

namespace fs = std::filesystem;
using fusion::Normalisation;

// What the thresholds are written for; runs with another camera are brought to it.
constexpr double kFocalPx = fusion::FineConfig{}.focal_px;

// Long enough for a window to forget what it saw, and a pause in which it starts to see again.
constexpr double kDark_s = 10.0;
constexpr double kLight_s = 15.0;

std::string read_text(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) fail_input("{}: cannot be read", file.string());
  return (std::ostringstream() << in.rdbuf()).str();
}

RunConfig resolved_config(const fs::path& run) {
  RunConfig config;
  config::read(config::load_file(run / "resolved.yaml"), config);
  return config;
}

std::string fingerprint_of(const fs::path& run) {
  RunConfig config = resolved_config(run);
  config.dataset.path.clear();
  const std::string text = config::to_yaml(config::to_node(config)) + read_text(run / "health.csv");
  return fmt::format("{:016x}", fingerprint(text));
}

// By how much a run's eigenvalues grow with a camera of kFocalPx in the place of its own.
double focal_scale(const RunConfig& config) {
  if (config.rig.find("cam0") == nullptr) return 1.0;
  const double ratio = kFocalPx / make_rig(config.rig).cameras.front().model.parameters().fx;
  return ratio * ratio;
}

// The name of the last folder of a path that may end with a slash.
std::string name_of(const fs::path& path) {
  const fs::path plain = fs::absolute(path).lexically_normal();
  return (plain.has_filename() ? plain : plain.parent_path()).stem().string();
}

RunConfig load_for(const fs::path& recording, const CalibrateOptions& options) {
  if (options.config.empty()) {
    fail_input("{}: is no run folder, and for a recording a configuration is needed: --config",
               recording.string());
  }
  std::vector<std::string> overrides = options.overrides;
  overrides.push_back("dataset.path=" + recording.string());
  overrides.emplace_back("vio.graph=paper");
  overrides.emplace_back("fusion.discriminator.fine.action=ignore");
  return load_run_config(options.config, overrides);
}

RunResult run_checked(const RunConfig& config, const fs::path& folder,
                      const CalibrateOptions& options) {
  RunResult result =
      run(config,
          {.folder = folder, .overwrite = options.overwrite, .interrupted = options.interrupted});
  if (result.interrupted) fail_run("interrupted; the runs so far are in {}", folder.string());
  return result;
}

// The same recording seen by camera and IMU alone, through spells of darkness.
fs::path run_dark(RunConfig config, double sequence_s, const fs::path& folder,
                  const CalibrateOptions& options) {
  config.sensors.use = {"camera", "imu"};
  config.dataset.blackout_s.clear();
  for (double t = kLight_s; t + kDark_s < sequence_s; t += kLight_s + kDark_s) {
    config.dataset.blackout_s.push_back({t, t + kDark_s});
  }
  run_checked(config, folder, options);
  return folder;
}

CalibrationRun run_recording(const fs::path& recording, const std::string& name,
                             const CalibrateOptions& options) {
  const RunConfig config = load_for(recording, options);
  const fs::path folder = options.folder / "runs" / name;
  const RunResult result = run_checked(config, folder, options);
  CalibrationRun run{name, fingerprint_of(folder), recorded_frames(folder), {}, {}};
  const fs::path dark = options.folder / "runs" / (name + "-dark");
  run.frames.blind = recorded_frames(run_dark(config, result.sequence_s, dark, options)).blind;
  return run;
}

CalibrationRun take_run(const fs::path& folder, const std::string& name) {
  if (resolved_config(folder).vio.graph != vio::GraphKind::paper) {
    log::warning(
        "{}: has DVL and pressure in its graph; thresholds that count them do not hold "
        "without (vio.graph: paper)",
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

std::vector<CalibrationRun> gather(const CalibrateOptions& options) {
  std::vector<CalibrationRun> runs;
  std::set<std::string> names;
  for (const fs::path& input : options.inputs) {
    std::string name = name_of(input);
    for (int i = 2; !names.insert(name).second; ++i) name = fmt::format("{}-{}", name_of(input), i);
    const bool finished = fs::exists(input / "health.csv") && fs::exists(input / "resolved.yaml");
    runs.push_back(finished ? take_run(input, name) : run_recording(input, name, options));
    if (runs.back().frames.healthy.empty()) {
      fail_run("{}: has no frame on which VIO was healthy; `apvi run` and its health.csv say why",
               input.string());
    }
  }
  return runs;
}

}  // namespace

fusion::RecordedFrames recorded_frames(const fs::path& run) {
  const RunConfig config = resolved_config(run);
  const bool divided = config.fusion.discriminator.fine.normalisation == Normalisation::per_inlier;
  const double scale = focal_scale(config);
  fusion::RecordedFrames frames;
  for (const HealthLine& line : read_health(run / "health.csv")) {
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
  if (options.inputs.empty()) fail_input("nothing to calibrate with: name recordings or runs");
  CalibrationResult result;
  result.runs = gather(options);
  result.normalisation = options.normalisation;
  const fusion::RecordedFrames frames = all_frames(result.runs);
  const auto fit = [&](Normalisation normalisation) {
    const auto found = fusion::calibrate_fine(frames, normalisation, options.max_false_alarm,
                                              result.min_directions);
    if (!found) fail_run("the healthy frames all have the same eigenvalues; nothing can be fitted");
    return *found;
  };
  result.plain = fit(Normalisation::none);
  result.per_inlier = fit(Normalisation::per_inlier);
  for (CalibrationRun& run : result.runs) {
    const auto tested = [&](const std::vector<fusion::RecordedFrame>& of) {
      return fusion::outcome(of, result.chosen().thresholds, result.normalisation,
                             result.min_directions);
    };
    run.healthy = tested(run.frames.healthy);
    run.blind = tested(run.frames.blind);
  }
  fs::create_directories(options.folder);
  io::write_text_file(options.folder / "thresholds.yaml", to_yaml(result));
  io::write_text_file(options.folder / "eigenvalues.csv", internal::eigenvalues_csv(result));
  io::write_text_file(options.folder / "calibration.json", internal::calibration_json(result));
  return result;
}

}  // namespace apvi::pipeline
