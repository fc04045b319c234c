// SPDX-License-Identifier: BSD-3-Clause
#include "runs/calibrate/rig_calibration.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <set>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/version.hpp"
#include "runs/run.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

/// The folder of the runs: the given one, or one that is deleted at the end.
class RunsFolder {
 public:
  explicit RunsFolder(const fs::path& kept)
      : deleted_(kept.empty()),
        path_(deleted_ ? fs::temp_directory_path() / fmt::format("apvi-calibrate-{}", getpid())
                       : kept) {}
  ~RunsFolder() {
    std::error_code ignored;
    if (deleted_) fs::remove_all(path_, ignored);
  }
  RunsFolder(const RunsFolder&) = delete;
  RunsFolder& operator=(const RunsFolder&) = delete;

  fs::path run(int round, std::size_t dive) const {
    return path_ / fmt::format("dive{}-round{}", dive + 1, round);
  }

 private:
  bool deleted_;
  fs::path path_;
};

RunConfig config_of(const fs::path& dive, const RigCalibrationOptions& options) {
  std::vector<std::string> overrides{"dataset.path=" + dive.string()};
  if (!options.rig.empty()) overrides.push_back("dataset.rig=" + options.rig.string());
  overrides.insert(overrides.end(), options.overrides.begin(), options.overrides.end());
  overrides.emplace_back("mapping.enabled=false");
  return load_run_config(options.config, overrides, options.search);
}

config::Node rig_of(const fs::path& dive, const RigCalibrationOptions& options) {
  const RunConfig config = config_of(dive, options);
  return resolve_rig(config, io::open_sequence(config.dataset, config.sensors.use)->rig());
}

std::string sensors_of(const config::Node& rig) {
  std::vector<std::string> found;
  for (const char* sensor : {"imu0", "cam0", "cam1", "dvl0", "pressure0", "depth0"}) {
    if (rig.find(sensor) != nullptr) found.emplace_back(sensor);
  }
  return fmt::format("{}", fmt::join(found, ", "));
}

void check_same(const fs::path& first, const config::Node& a, const fs::path& other,
                const config::Node& b) {
  if (sensors_of(a) != sensors_of(b)) {
    fail_input("different sensors: {} has {}; {} has {}; calibrate dives of one vehicle",
               first.string(), sensors_of(a), other.string(), sensors_of(b));
  }
  if (config::to_yaml(a) != config::to_yaml(b)) {
    fail_input("the rigs of {} and {} differ: name the one to start from with --rig",
               first.string(), other.string());
  }
}

config::Node common_rig(const RigCalibrationOptions& options) {
  const fs::path& first = options.dives.front();
  config::Node rig = rig_of(first, options);
  if (make_rig(rig).cameras.empty()) {
    fail_input("{}: the rig has no camera (cam0), and so no self-calibration", first.string());
  }
  for (const fs::path& dive : options.dives) check_same(first, rig, dive, rig_of(dive, options));
  return rig;
}

void check_dives(const std::vector<fs::path>& dives) {
  if (dives.empty()) fail_input("no dive: name recordings");
  std::set<fs::path> seen;
  for (const fs::path& dive : dives) {
    if (!fs::exists(dive)) fail_input("{}: no such recording", dive.string());
    if (!seen.insert(fs::canonical(dive)).second) {
      fail_input("{}: given twice, which would count its information twice", dive.string());
    }
  }
}

std::string commented(const std::string& text) {
  std::string lines = "# ";
  for (const char c : text) lines += c == '\n' ? "\n# " : std::string(1, c);
  return lines;
}

void write_rig(const fs::path& file, const RigCalibration& calibration) {
  const std::string head = fmt::format("Refined by `apvi calibrate rig` ({}, {}), {} rounds.\n",
                                       kVersion, kGitRevision, calibration.rounds);
  io::write_text_file(
      file, commented(head + to_table(calibration)) + "\n" + config::to_yaml(calibration.rig));
}

}  // namespace

RigCalibration calibrate_rig(const RigCalibrationOptions& options) {
  check_dives(options.dives);
  const config::Node rig = common_rig(options);
  const RunsFolder folder(options.runs);
  const auto localize = [&](std::size_t dive, const config::Node& now,
                            int round) -> std::optional<vio::CalibrationEstimate> {
    RunConfig config = config_of(options.dives[dive], options);
    config.rig = now;
    config.vio.calibration.release_sigmas = 0.0;  // all parameters are asked for
    const RunResult result =
        run(config, {.folder = folder.run(round, dive), .interrupted = options.interrupted});
    if (result.interrupted) return std::nullopt;
    return result.calibration;
  };
  std::vector<std::string> names;
  for (const fs::path& dive : options.dives) names.push_back(dive.string());
  RigCalibration found = refine_rig(rig, names, localize);
  write_rig(options.output, found);
  return found;
}

}  // namespace apvi::runs
