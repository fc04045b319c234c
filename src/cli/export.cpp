// SPDX-License-Identifier: BSD-3-Clause
#include "runs/export.hpp"

#include <filesystem>
#include <memory>
#include <string>

#include "apvi/core/log.hpp"
#include "cli/commands.hpp"
#include "map_io/ply.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  fs::path run;
  std::string format;
  fs::path out;
};

void export_run(const Arguments& a) {
  const runs::FinishedRun run = runs::load_finished_run(a.run);
  const gaussians::Gaussians map = map_io::read_ply(run.map);
  const fs::path out = a.out.empty() ? a.run / a.format : a.out;
  if (a.format == "colmap") {
    runs::export_colmap(out, run.keyframes, map);
  } else if (a.format == "nerfstudio") {
    runs::export_nerfstudio(out, run.keyframes, map);
  } else {
    fs::create_directories(out);
    map_io::write_ply(out / "map.ply", map, map_io::read_ply_medium(run.map));
  }
  log::info("{} Gaussians and {} keyframes in {}", map.size(), run.keyframes.size(), out.string());
}

}  // namespace

void add_export(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* command =
      app.add_subcommand("export", "export a run's map, images and poses to other formats");
  command->add_option("RUN", a->run, "run folder")->required();
  command->add_option("--format", a->format, "output format")
      ->required()
      ->check(CLI::IsMember({"ply", "colmap", "nerfstudio"}))
      ->type_name("WORD");
  command->add_option("-o,--output", a->out, "output folder (default: RUN/FORMAT)");
  command->callback([a] { export_run(*a); });
}

}  // namespace apvi::cli
