// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/bridge/export.hpp"

#include <filesystem>
#include <memory>
#include <string>

#include "apvi/core/log.hpp"
#include "apvi/splat/ply.hpp"
#include "commands.hpp"

namespace apvi::apps {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  fs::path run;
  std::string format;
  fs::path out;
};

void export_run(const Arguments& a) {
  const bridge::FinishedRun run = bridge::open_run(a.run);
  const splat::Gaussians map = splat::read_ply(run.map);
  const fs::path out = a.out.empty() ? a.run / a.format : a.out;
  if (a.format == "colmap") {
    bridge::export_colmap(out, run.keyframes, map);
  } else if (a.format == "nerfstudio") {
    bridge::export_nerfstudio(out, run.keyframes, map);
  } else {
    fs::create_directories(out);
    splat::write_ply(out / "map.ply", map, splat::read_ply_medium(run.map));
  }
  log::info("{} Gaussians and {} keyframes in {}", map.size(), run.keyframes.size(), out.string());
}

}  // namespace

void add_export(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* command =
      app.add_subcommand("export", "a run's map, images and poses in formats others open");
  command->add_option("RUN", a->run, "run folder")->required();
  command->add_option("--format", a->format, "what for")
      ->required()
      ->check(CLI::IsMember({"ply", "colmap", "nerfstudio"}))
      ->type_name("WORD");
  command->add_option("-o,--output", a->out, "folder (default: one of that name in the run)");
  command->callback([a] { export_run(*a); });
}

}  // namespace apvi::apps
