// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "cli/commands.hpp"
#include "cli/configurations.hpp"
#include "core/stopwatch.hpp"
#include "sim/simulate.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  std::vector<fs::path> scenes;
  fs::path out;
  std::vector<std::string> overrides;
  bool no_images = false;
  sim::SimulateOptions options;
};

void add_options(CLI::App& command, Arguments& a) {
  command.add_option("SCENE", a.scenes, "scene file; each one produces a dataset")
      ->type_name("FILE")
      ->required();
  command
      .add_option("-o,--output", a.out,
                  "dataset folder; with several scenes the parent folder of the datasets")
      ->required()
      ->type_name("DATASET");
  const std::map<std::string, sim::OutputFormat> formats = {{"folder", sim::OutputFormat::folder},
                                                            {"euroc", sim::OutputFormat::euroc},
                                                            {"rosbag", sim::OutputFormat::rosbag},
                                                            {"tank", sim::OutputFormat::tank},
                                                            {"colmap", sim::OutputFormat::colmap}};
  command
      .add_option_function<std::string>(
          "--format",
          [&a, formats](const std::string& word) { a.options.format = formats.at(word); },
          "folder: this project's format (default); euroc; rosbag: with the topics of the Tank "
          "dataset; tank: its raw folder format; colmap: images with a COLMAP model of the true "
          "poses")
      ->check(CLI::IsMember(formats))
      ->type_name("WORD");
  command
      .add_option("--set", a.overrides,
                  "override a key of the scene, e.g. motion.speed_m_s=0.3; repeatable")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
  a.options.threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  command
      .add_option("-j,--threads", a.options.threads,
                  "number of threads; does not affect the result")
      ->check(CLI::Range(1, 1024))
      ->type_name("N")
      ->capture_default_str();
  command.add_flag("--no-images", a.no_images, "skip the camera images");
}

sim::Scene load_scene(const fs::path& file, const std::vector<std::string>& overrides) {
  return sim::load_scene(find_configuration(file), overrides, configuration_folders());
}

void simulate_one(const fs::path& file, const fs::path& out, const Arguments& a) {
  std::vector<std::string> overrides = a.overrides;
  if (a.no_images) overrides.emplace_back("camera.enabled=false");
  const sim::Scene scene = load_scene(file, overrides);
  const Stopwatch watch;
  if (sim::simulate(scene, out, a.options) == sim::SimulateResult::already_complete) {
    log::info("{}: already complete", out.string());
  } else {
    log::info("{}: {:g} s simulated in {:.1f} s", out.string(), scene.config.duration_s,
              watch.seconds());
  }
}

void run(const Arguments& a) {
  if (a.scenes.size() == 1) return simulate_one(a.scenes.front(), a.out, a);
  for (const fs::path& file : a.scenes) load_scene(file, a.overrides);  // errors before starting
  for (const fs::path& file : a.scenes) simulate_one(file, a.out / file.stem(), a);
}

}  // namespace

void add_sim(CLI::App& app) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command = *app.add_subcommand(
      "sim", "simulate an underwater sequence with all sensors and ground truth");
  add_options(command, *arguments);
  command.callback([arguments] { run(*arguments); });
}

}  // namespace apvi::cli
