// SPDX-License-Identifier: BSD-3-Clause
#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/sequence.hpp"
#include "cli/commands.hpp"
#include "cli/configurations.hpp"
#include "cli/import_support.hpp"
#include "cli/mapping_support.hpp"
#include "cli/report.hpp"
#include "cli/run_support.hpp"
#include "core/foreign_file.hpp"
#include "core/interrupt.hpp"
#include "core/text.hpp"
#include "runs/run.hpp"
#include "runs/run_folder.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  fs::path target;
  std::vector<std::string> overrides;
  fs::path folder;
  bool overwrite = false;
  bool resume = false;
  bool no_report = false;
  bool strict = false;
  fs::path known_map;
  importer::ImportOptions import_options;
  ViewOptions view;
};

// A recording is run by the default configuration.
struct Source {
  fs::path configuration;
  std::vector<std::string> overrides;
};

Source recording_source(const fs::path& recording, const std::vector<std::string>& overrides) {
  Source source{find_configuration("default.yaml"), {"dataset.path=" + recording.string()}};
  const auto append = [&source](const std::vector<std::string>& more) {
    source.overrides.insert(source.overrides.end(), more.begin(), more.end());
  };
  append(overrides_of_import(recording));
  append(overrides);
  return source;
}

Source source_of(const Arguments& a) {
  const std::string extension = text::to_lower(fs::path(a.target).extension().string());
  const bool recording = fs::is_directory(a.target) || extension == ".bag" ||
                         extension == ".mcap" || extension == ".db3";
  if (recording) return recording_source(a.target, a.overrides);
  // A case of a sweep on Slurm is a .job.
  const bool configuration =
      extension.empty() || extension == ".yaml" || extension == ".yml" || extension == ".job";
  if (!configuration && fs::exists(a.target)) {
    const auto foreign = describe_foreign_file(a.target);
    if (foreign) fail_input("{}: not a recording, but {}", a.target.string(), *foreign);
    fail_input("{}: not a recording (folder, .bag, .mcap, .db3), video, or configuration (.yaml)",
               a.target.string());
  }
  return {find_configuration(a.target), a.overrides};
}

runs::RunConfig load_config(const Source& source) {
  runs::RunConfig config =
      runs::load_run_config(source.configuration, source.overrides, configuration_folders());
  if (config.dataset.path.empty()) {
    fail_input("{}: dataset.path: missing; name the recording: --set dataset.path=RECORDING",
               source.configuration.string());
  }
  return config;
}

std::string name_of(const fs::path& path) {
  const fs::path normal = path.lexically_normal();
  return (normal.has_filename() ? normal.stem() : normal.parent_path().stem()).string();
}

// runs/<dataset>, or runs/<configuration>-<dataset>.
fs::path default_folder(const Arguments& a, const runs::RunConfig& config) {
  const std::string data = name_of(config.dataset.path);
  const std::string target = name_of(a.target);
  return vacant_folder(target == data ? data : target + "-" + data);
}

// A video, photographs, a COLMAP model or a log become RUN/input, which is then run.
Source import_source(const Arguments& a, const fs::path& folder) {
  const fs::path input = folder / "input";
  if (!a.resume) {
    runs::check_vacant(folder, a.overwrite);
    importer::ImportOptions options = a.import_options;
    options.overwrite = true;
    import_into(a.target, input, options);
  }
  return recording_source(input, a.overrides);
}

// A resumed run reads the calibration only.
std::unique_ptr<io::SequenceReader> open_recording(const runs::RunConfig& config, bool resume) {
  const std::vector<std::string> camera = {"camera"};
  return io::open_sequence(config.dataset, resume ? camera : config.sensors.use);
}

/// Returns the number of warnings about sensors and results.
std::size_t run_into(const fs::path& folder, const runs::RunConfig& config, const Arguments& a) {
  const InterruptGuard guard;
  const auto interrupted = [&guard] { return guard.interrupted(); };
  if (a.view.port && !config.localization.enabled) {
    fail_input("--view: only with localization.enabled: true; use apvi view afterwards");
  }
  const auto observer = open_view(folder, a.view);
  const MappingRequest map{.folder = folder,
                           .overwrite = a.overwrite,
                           .resume = a.resume,
                           .interrupted = interrupted,
                           .observer = observer.get()};
  if (!config.localization.enabled) {
    make_map(config, map);
    return 0;
  }
  const auto recording = open_recording(config, a.resume);
  std::optional<runs::RunResult> result;
  if (a.resume || runs::makes_map(config, *recording)) {
    result = localize_and_map(config, *recording, map);
  } else {
    result = runs::run(config, *recording,
                       {.folder = folder,
                        .overwrite = a.overwrite,
                        .interrupted = interrupted,
                        .observer = observer.get()});
  }
  if (!result) return 0;
  report(*result);
  return result->warnings.size();
}

void run(Arguments a) {
  if (!a.known_map.empty()) a.overrides.push_back("smoothing.known_map=" + a.known_map.string());
  const bool imports = importer::source_kind(a.target).has_value();
  fs::path folder = a.folder;
  if (imports && folder.empty()) folder = vacant_folder(name_of(a.target));
  const Source source = imports ? import_source(a, folder) : source_of(a);
  const runs::RunConfig config = load_config(source);
  if (folder.empty()) folder = default_folder(a, config);
  const std::size_t warnings = run_into(folder, config, a);
  // The report is that of a trajectory, which a map from given poses does not have.
  if (!a.no_report && fs::exists(folder / "trajectory.tum")) write_report(folder);
  log::info("results in {}", folder.string());
  if (!a.strict || warnings == 0) return;
  fail_run("--strict: {} warnings about sensors or results; see metrics.json", warnings);
}

}  // namespace

void add_run(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand(
      "run", "localize a recording and, if it has a camera, map it, into a run folder");
  command
      ->add_option("DIVE|CONFIG", a->target,
                   "recording, video, photographs, COLMAP or Metashape model, log of an autopilot, "
                   "or configuration (.yaml)")
      ->type_name("FILE|FOLDER")
      ->required();
  add_overrides(*command, a->overrides,
                "override a configuration key, e.g. dataset.path=FOLDER; repeatable");
  command
      ->add_option("-o,--output", a->folder, "run folder (default: runs/DIVE or runs/CONFIG-DIVE)")
      ->type_name("FOLDER");
  command
      ->add_option("--map", a->known_map,
                   "run folder of an earlier dive: find this dive in its map, from the images")
      ->type_name("RUN");
  command->add_flag("--overwrite", a->overwrite, "replace an existing run in the folder");
  command->add_flag("--resume", a->resume, "resume the folder's map from its checkpoint");
  command->add_flag("--no-report", a->no_report, "do not write report.html");
  command->add_flag("--strict", a->strict,
                    "exit with status 1 when a sensor did not serve or a result is implausible");
  add_view_options(*command, a->view);
  add_import_options(*command, a->import_options);
  command->callback([a] { run(*a); });
}

}  // namespace apvi::cli
