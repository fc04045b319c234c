// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "apvi/core/error.hpp"
#include "cli/mapping_support.hpp"
#include "eval/metrics_file.hpp"
#include "runs/quality/patch_colors.hpp"

namespace apvi::cli {
namespace {

std::string row(const char* name, double image, double restored) {
  return fmt::format("  {:<28} {:>6.1f} {:>9.1f}\n", name, image, restored);
}

std::string to_table(const runs::PatchErrors& errors) {
  std::string table =
      fmt::format("{} patches: mean angle to the known color [deg]\n  {:<28} {:>6} {:>9}\n",
                  errors.patches, "", "image", "restored");
  table += row("as they are", errors.image_deg, errors.restored_deg);
  if (errors.image_balanced_deg) {
    table +=
        row("after one white balance", *errors.image_balanced_deg, *errors.restored_balanced_deg);
  }
  return table;
}

}  // namespace

std::string eval_patches(const std::filesystem::path& run, const std::filesystem::path& patches,
                         bool json) {
  if (!std::filesystem::is_directory(run)) fail_input("{}: no such folder", run.string());
  const runs::PatchErrors errors =
      runs::errors_of(runs::measure_patches(run, runs::read_patches(patches)));
  const std::filesystem::path file = run / "metrics.json";
  eval::Json mapping = eval::read_metrics(file).value("mapping", eval::Json::object());
  mapping["patches"] = runs::to_json(errors);
  eval::merge_metrics(file, {{"mapping", mapping}});
  return json ? mapping["patches"].dump(2) + "\n" : to_table(errors);
}

}  // namespace apvi::cli
