// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/bridge/render_run.hpp"

#include <memory>

#include "apvi/core/log.hpp"
#include "commands.hpp"

namespace apvi::apps {

void add_render(CLI::App& app) {
  const auto r = std::make_shared<bridge::RenderRequest>();
  CLI::App* command =
      app.add_subcommand("render", "images from a map along a path or from one camera");
  command->add_option("SOURCE", r->source, "run folder, or a map.ply")->required();
  command->add_option("--path", r->path, "poses to render from (TUM); default: the run's keyframes")
      ->type_name("FILE");
  command->add_option("--camera", r->camera, "camera.json: one view, or the lens for --path")
      ->type_name("FILE");
  command->add_flag("--restore", r->restore, "also as it would look without water");
  command->add_flag("--depth", r->depth, "also depth: 16-bit PNG in millimetres");
  command->add_flag("--float", r->as_float, "PFM instead of PNG; depth in metres");
  command->add_option("-o,--output", r->out, "folder for the images")->required();
  command->callback([r] {
    const std::size_t count = bridge::render_run(*r);
    log::info("{} views in {}", count, r->out.string());
  });
}

}  // namespace apvi::apps
