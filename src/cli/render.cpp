// SPDX-License-Identifier: BSD-3-Clause
#include "runs/render_run.hpp"

#include <memory>

#include "apvi/core/log.hpp"
#include "cli/commands.hpp"

namespace apvi::cli {

void add_render(CLI::App& app) {
  const auto r = std::make_shared<runs::RenderRequest>();
  CLI::App* command =
      app.add_subcommand("render", "render images from a map along a path or from one camera");
  command->add_option("SOURCE", r->source, "run folder, or a map file: .ply or .spz")->required();
  command
      ->add_option("--path", r->path,
                   "trajectory to render along (TUM); default: the run's keyframes")
      ->type_name("FILE");
  command
      ->add_option("--camera", r->camera,
                   "camera.json: a single view, or the intrinsics for --path")
      ->type_name("FILE");
  command->add_flag("--restore", r->restore, "also render without water");
  command->add_flag("--depth", r->depth, "also render depth: 16-bit PNG in millimeters");
  command->add_flag("--float", r->as_float, "PFM instead of PNG; depth in meters");
  command->add_option("-o,--output", r->out, "output folder")->required();
  command->callback([r] {
    const std::size_t count = runs::render_run(*r);
    log::info("{} views in {}", count, r->out.string());
  });
}

}  // namespace apvi::cli
