// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/config/sweep.hpp"
#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sim/scene_config.hpp"
#include "commands.hpp"
#include "mapping_half.hpp"

namespace apvi::apps {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  std::vector<fs::path> files;
  bool markdown = false;
};

bool has_any(const config::Node& node, std::initializer_list<const char*> keys) {
  return std::any_of(keys.begin(), keys.end(),
                     [&](const char* key) { return node.find(key) != nullptr; });
}

// What a file is shows in its keys. Returns its kind once it is found to be right.
std::string check_file(const fs::path& file) {
  const config::Node node = config::load_with_inheritance(file);
  if (has_any(node, {"body", "imu0", "dvl0", "cam0"})) {
    make_rig(node);
    return "rig";
  }
  if (has_any(node, {"world", "water", "light", "motion", "events"})) {
    sim::SceneConfig scene;
    config::read(node, scene);
    return "scene";
  }
  if (has_any(node, {"base", "cases", "grid"})) {
    config::load_sweep(file);
    return "sweep";
  }
  load_run_config(file, {});
  return "run configuration";
}

void check_files(const std::vector<fs::path>& files) {
  std::size_t wrong = 0;
  for (const fs::path& file : files) {
    try {
      const std::string kind = check_file(file);
      std::printf("%s: ok (%s)\n", file.c_str(), kind.c_str());
    } catch (const InputError& e) {
      log::error("{}", e.what());
      ++wrong;
    }
  }
  if (wrong > 0) fail_input("{} of {} files are wrong", wrong, files.size());
}

void print_markdown() {
  const auto section = [](const char* title, const char* text, const std::string& table) {
    std::printf("\n## %s\n\n%s\n\n%s", title, text, table.c_str());
  };
  std::printf(
      "%s",
      "# Configuration keys\n\n"
      "Made by `apvi config --markdown`. A file may name others under `inherit:` (one or a "
      "list, relative to itself); the file itself wins, and `--set key=value` wins over the "
      "file. Unknown keys, duplicate keys and values out of range are errors.\n");
  section("Runs",
          "`apvi run FILE`: files in `configs/`, `configs/datasets/`, `configs/experiments/`.",
          config::to_markdown(config::document(RunConfig{})));
  section("Rigs", "`rig.yaml` of a data set, and the `rig:` section of runs and scenes.",
          rig_documentation());
  section("Scenes", "`apvi sim FILE`: files in `configs/scenes/`.",
          config::to_markdown(config::document(sim::SceneConfig{})));
  section("Sweeps", "`apvi sweep FILE`: files in `configs/ablations/`, `configs/sweeps/`.",
          config::to_markdown(config::document(config::SweepFile{})));
}

// One aligned line per key, with its meaning below.
void print_keys(const char* title, const std::vector<config::FieldDoc>& rows) {
  std::printf("\n%s\n", title);
  for (const config::FieldDoc& row : rows) {
    if (row.type == "section") {
      std::printf("\n  %s: %s\n", row.key.c_str(), row.doc.c_str());
      continue;
    }
    std::string range = row.range;
    for (std::size_t at = range.find("\\|"); at != std::string::npos; at = range.find("\\|")) {
      range.erase(at, 1);
    }
    std::printf("  %-44s %-18s %-20s %s\n", row.key.c_str(), row.default_value.c_str(),
                range.c_str(), row.doc.c_str());
  }
}

void run_config(const Arguments& a) {
  if (!a.files.empty()) {
    check_files(a.files);
  } else if (a.markdown) {
    print_markdown();
  } else {
    print_keys("apvi run: key, default, range, meaning", config::document(RunConfig{}));
    print_keys("apvi sim: key, default, range, meaning", config::document(sim::SceneConfig{}));
  }
}

}  // namespace

void add_config(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand(
      "config", "prints every configuration key with default, range and meaning; checks files");
  command->add_option("--check", a->files, "check these files: runs, scenes, rigs, sweeps")
      ->type_name("FILE");
  command->add_flag("--markdown", a->markdown, "print docs/config.md");
  command->callback([a] { run_config(*a); });
}

}  // namespace apvi::apps
