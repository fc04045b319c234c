// SPDX-License-Identifier: BSD-3-Clause
#include "runs/survey/export.hpp"

#include <filesystem>
#include <memory>
#include <string>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "cli/commands.hpp"
#include "cli/export_survey.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  fs::path source;
  std::string format;
  fs::path out;
  runs::SurveyRequest survey;
};

bool is_dataset_format(const std::string& format) {
  return format == "colmap" || format == "nerfstudio";
}

void export_dataset(const Arguments& a) {
  const runs::FinishedRun run = runs::load_finished_run(a.source);
  const fs::path out = a.out.empty() ? a.source / a.format : a.out;
  if (a.format == "colmap") {
    runs::export_colmap(out, run.keyframes, run.map);
  } else {
    runs::export_nerfstudio(out, run.keyframes, run.map);
  }
  log::info("{} Gaussians and {} keyframes in {}", run.map.gaussians.size(), run.keyframes.size(),
            out.string());
}

std::string ending_of(const std::string& format) {
  return format == "compressed_ply" ? ".compressed.ply" : "." + format;
}

// A map file; without a format, --output is its name.
fs::path map_file_name(const Arguments& a) {
  if (map_io::is_map_name(a.out)) {
    if (!a.format.empty() && !a.out.string().ends_with(ending_of(a.format))) {
      fail_input("--output: {}: not a file {}", a.out.string(), ending_of(a.format));
    }
    return a.out;
  }
  if (a.format.empty()) {
    fail_input("--format: required, unless --output names a file .ply, .compressed.ply or .spz");
  }
  if (a.out.empty() && !fs::is_directory(a.source)) fail_input("--output: required for a map file");
  return (a.out.empty() ? a.source / a.format : a.out) / ("map" + ending_of(a.format));
}

void export_map(const Arguments& a) {
  const fs::path file = map_file_name(a);
  const map_io::MapFile map = runs::load_map(a.source);
  if (file.has_parent_path()) fs::create_directories(file.parent_path());
  map_io::write_map(file, map);
  if (map.medium && file.extension() == ".spz") {
    log::warning("{}: this format has no medium", file.string());
  }
  log::info("{} Gaussians in {}", map.gaussians.size(), file.string());
}

void export_product(const Arguments& a) {
  runs::SurveyRequest request = a.survey;
  request.source = a.source;
  request.product = a.format;
  request.out = a.out.empty() && fs::is_directory(a.source) ? a.source / a.format : a.out;
  if (request.out.empty()) fail_input("--output: required for a map file");
  for (const char* ending : {".tif", ".las", ".csv", ".ply", ".glb", ".json"}) {
    if (request.out.extension() != ending) continue;
    fail_input("--output: {}: give a folder, --format {} chooses the names of files",
               request.out.string(), a.format);
  }
  export_survey_product(std::move(request));
}

void export_source(const Arguments& a) {
  if (runs::is_survey_product(a.format)) {
    export_product(a);
  } else if (is_dataset_format(a.format)) {
    export_dataset(a);
  } else {
    export_map(a);
  }
}

}  // namespace

void add_export(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand(
      "export", "export a run's map, images and poses, or make products of a survey");
  command->add_option("SOURCE", a->source, "run folder, or a map file")
      ->type_name("FILE|FOLDER")
      ->required();
  command
      ->add_option("--format", a->format,
                   "output format; not needed when --output names a map file")
      ->check(CLI::IsMember({"ply", "compressed_ply", "spz", "colmap", "nerfstudio", "orthomosaic",
                             "elevation", "mesh", "las", "poses", "survey"}))
      ->type_name("WORD");
  command
      ->add_option("-o,--output", a->out,
                   "output folder (default: RUN/FORMAT), or a file .ply, .compressed.ply, .spz")
      ->type_name("FILE|FOLDER");
  add_survey_options(*command, a->survey);
  command->callback([a] { export_source(*a); });
}

}  // namespace apvi::cli
