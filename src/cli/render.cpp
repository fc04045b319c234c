// SPDX-License-Identifier: BSD-3-Clause
#include "runs/views/render_run.hpp"

#include <memory>
#include <optional>
#include <string>

#include "apvi/core/log.hpp"
#include "cli/commands.hpp"

namespace apvi::cli {
namespace {

/// A positive number; empty: not one.
std::optional<double> factor_of(const std::string& text) {
  double value = 0.0;
  if (!CLI::detail::lexical_cast(text, value) || !(value > 0.0)) return std::nullopt;
  return value;
}

void add_display_options(CLI::App& command, runs::RenderRequest& r) {
  command
      .add_option_function<std::string>(
          "--exposure", [&r](const std::string& text) { r.exposure = factor_of(text); },
          "brightness of restored images: a factor, or auto (default): chosen once for the map")
      ->check([](const std::string& text) {
        return text == "auto" || factor_of(text) ? "" : "'" + text + "' is not auto or a factor";
      })
      ->type_name("auto|FACTOR");
  command
      .add_option_function<std::string>(
          "--white-balance", [&r](const std::string& text) { r.white_balance = text == "auto"; },
          "of restored images: auto (default): chosen once for the map; none")
      ->check(CLI::IsMember({"auto", "none"}))
      ->type_name("WORD");
}

void add_format_options(CLI::App& command, runs::RenderRequest& r) {
  CLI::Option* const pfm = command.add_flag_callback(
      "--float", [&r] { r.format = runs::ImageFormat::pfm; },
      "PFM instead of PNG; depth in meters");
  command
      .add_flag_callback(
          "--exr", [&r] { r.format = runs::ImageFormat::exr; },
          "OpenEXR instead of PNG: colors in linear light, depth in meters")
      ->excludes(pfm);
  command.add_option("--bits", r.bits, "bits per channel of color PNGs: 8 (default) or 16")
      ->check(CLI::IsMember({8, 16}))
      ->type_name("N");
}

}  // namespace

void add_render(CLI::App& app) {
  const auto r = std::make_shared<runs::RenderRequest>();
  CLI::App* command =
      app.add_subcommand("render", "render images from a map along a path or from one camera");
  command->add_option("SOURCE", r->source, "run folder, or a map file: .ply or .spz")
      ->type_name("FILE|FOLDER")
      ->required();
  command
      ->add_option("--path", r->path,
                   "trajectory to render along (TUM); default: the run's keyframes")
      ->type_name("FILE");
  command
      ->add_option("--camera", r->camera,
                   "camera.json: a single view, or the intrinsics for --path")
      ->type_name("FILE");
  command->add_flag("--restore", r->restore, "also render restored images (without the medium)");
  command->add_flag("--depth", r->depth, "also render depth: 16-bit PNG in millimeters");
  command
      ->add_option(
          "--detail", r->detail_px,
          "leave out details smaller than so many pixels: faster for large maps, and fewer "
          "artifacts far away (default: 0, all Gaussians)")
      ->type_name("PIXELS")
      ->check(CLI::Range(0.0, 100.0));
  add_format_options(*command, *r);
  add_display_options(*command, *r);
  command->add_option("-o,--output", r->out, "output folder")->type_name("FOLDER")->required();
  command->callback([r] {
    const std::size_t count = runs::render_run(*r);
    log::info("{} views in {}", count, r->out.string());
  });
}

}  // namespace apvi::cli
