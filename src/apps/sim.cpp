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
#include "apvi/core/stopwatch.hpp"
#include "apvi/sim/simulate.hpp"
#include "commands.hpp"

namespace apvi::apps {
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
  command.add_option("SCENE", a.scenes, "scene file; several make one data set each")->required();
  command
      .add_option("-o,--output", a.out,
                  "the data set's folder, or with several scenes the folder of their folders")
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
          "this project's folder (default), EuRoC as published, a ROS bag with the topics of the "
          "Tank "
          "data set, its raw folder, or images with a COLMAP model of the true poses")
      ->check(CLI::IsMember(formats))
      ->type_name("WORD");
  command.add_option("--set", a.overrides, "change a key of the scene, like motion.speed_m_s=0.3")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
  a.options.threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  command.add_option("-j,--threads", a.options.threads, "threads; the result is the same with any")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  command.add_flag("--no-images", a.no_images, "all sensors but the cameras");
}

void simulate_one(const fs::path& file, const fs::path& out, const Arguments& a) {
  std::vector<std::string> overrides = a.overrides;
  if (a.no_images) overrides.emplace_back("camera.enabled=false");
  const sim::Scene scene = sim::load_scene(file, overrides);
  const Stopwatch watch;
  if (sim::simulate(scene, out, a.options) == sim::Outcome::was_complete) {
    log::info("{}: is complete already", out.string());
  } else {
    log::info("{}: {:g} s simulated in {:.1f} s", out.string(), scene.config.duration_s,
              watch.seconds());
  }
}

void run(const Arguments& a) {
  if (a.scenes.size() == 1) return simulate_one(a.scenes.front(), a.out, a);
  for (const fs::path& file : a.scenes) sim::load_scene(file, a.overrides);  // complain at once
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

}  // namespace apvi::apps
