// SPDX-License-Identifier: BSD-3-Clause
#include <filesystem>
#include <memory>

#include "apvi/core/log.hpp"
#include "cli/commands.hpp"
#include "cli/import_support.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  fs::path source;
  fs::path out;
  importer::ImportOptions options;
};

void import_source_of(const Arguments& a) {
  import_into(a.source, a.out, a.options);
  const auto notes = importer::read_notes(a.out);
  if (notes && notes->kind == "photos" && notes->poses == 0) {
    log::warning(
        "{}: photographs can be localized only if each shows most of what the one before it shows, "
        "as in a video; reconstruct others with COLMAP, then import its folder",
        a.out.string());
  }
  log::info("next: apvi run {}", a.out.string());
}

}  // namespace

void add_import(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand(
      "import",
      "make a data set folder of a video, photographs, a COLMAP or Metashape model or a log");
  command
      ->add_option("SOURCE", a->source,
                   "video file (with a GoPro's IMU, if it has one), folder of JPEG or PNG images, "
                   "folder of a COLMAP model (sparse/0, text or binary), cameras exported by "
                   "Metashape (.xml) or a folder with them, or log of an autopilot "
                   "(.tlog, .BIN)")
      ->required();
  command->add_option("-o,--output", a->out, "data set folder to create")
      ->required()
      ->type_name("DIVE");
  command->add_flag("--overwrite", a->options.overwrite, "replace an earlier import in the folder");
  add_import_options(*command, a->options);
  command->callback([a] { import_source_of(*a); });
}

}  // namespace apvi::cli
