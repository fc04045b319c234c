// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate_files.hpp"

#include <fmt/format.h>

#include <iterator>
#include <nlohmann/json.hpp>

#include "apvi/pipeline/calibrate.hpp"
#include "apvi/version.hpp"

namespace apvi::pipeline {
namespace {

using Json = nlohmann::ordered_json;
using fusion::EigenThresholds;
using fusion::FineCalibration;
using fusion::FineOutcome;
using fusion::Normalisation;
using fusion::RecordedFrame;
using fusion::Semicircle;

const char* name_of(Normalisation normalisation) {
  return normalisation == Normalisation::none ? "none" : "per_inlier";
}

void append_rows(std::string& text, const std::string& run, const char* kind,
                 const std::vector<RecordedFrame>& frames) {
  for (const RecordedFrame& f : frames) {
    const auto& r = f.eigenvalues.rotation;
    const auto& p = f.eigenvalues.position;
    fmt::format_to(std::back_inserter(text), "{},{},{},{:.4g},{:.4g},{:.4g},{:.4g},{:.4g},{:.4g}\n",
                   run, kind, f.inliers, r(0), r(1), r(2), p(0), p(1), p(2));
  }
}

Json json_of(const Semicircle& fit, double threshold) {
  return {{"mean", fit.mean},
          {"radius", 2.0 * fit.deviation},
          {"logarithmic", fit.logarithmic},
          {"edge", fit.lower_edge},
          {"threshold", threshold},
          {"misfit", fit.misfit},
          {"share_below_edge", fit.share_below},
          {"eigenvalues", fit.count}};
}

Json json_of(const FineOutcome& outcome) {
  return {{"frames", outcome.frames},
          {"rejected", outcome.rejected},
          {"rejected_by_remap", outcome.rejected_by_remap},
          {"directions", outcome.directions}};
}

Json json_of(const FineCalibration& c) {
  return {{"normalisation", name_of(c.normalisation)},
          {"rotation", json_of(c.fit.rotation, c.thresholds.rotation)},
          {"position", json_of(c.fit.position, c.thresholds.position)},
          {"healthy", json_of(c.healthy)},
          {"blind", json_of(c.blind)},
          {"healthy_at_edge", json_of(c.healthy_at_edge)},
          {"blind_at_edge", json_of(c.blind_at_edge)}};
}

std::string outcome_cells(const FineOutcome& healthy, const FineOutcome& blind) {
  return fmt::format("{:.2f} % of {} | {:.1f} % of {}", 100.0 * healthy.rejected, healthy.frames,
                     100.0 * blind.rejected, blind.frames);
}

std::string row(const std::string& name, const EigenThresholds& thresholds,
                const FineOutcome& healthy, const FineOutcome& blind) {
  return fmt::format("| {} | {:.3g} | {:.3g} | {} |\n", name, thresholds.rotation,
                     thresholds.position, outcome_cells(healthy, blind));
}

// A frame is rejected by remapping when too few directions are left.
FineOutcome by_remap(FineOutcome outcome) {
  outcome.rejected = outcome.rejected_by_remap;
  return outcome;
}

std::string rows(const std::string& name, const FineCalibration& c) {
  const std::string remap =
      fmt::format("{}, remapped ({:.2f} directions kept, of blind ones {:.2f})", name,
                  c.healthy.directions, c.blind.directions);
  return row(name + ", edges of the fit", c.fit.thresholds(), c.healthy_at_edge, c.blind_at_edge) +
         row(name + ", thresholds", c.thresholds, c.healthy, c.blind) +
         row(remap, c.thresholds, by_remap(c.healthy), by_remap(c.blind));
}

}  // namespace

std::string internal::eigenvalues_csv(const CalibrationResult& result) {
  std::string text =
      "#run,kind,landmarks,rotation_1 [rad^-2],rotation_2 [rad^-2],rotation_3 [rad^-2],"
      "position_1 [m^-2],position_2 [m^-2],position_3 [m^-2]\n";
  for (const CalibrationRun& run : result.runs) {
    append_rows(text, run.name, "healthy", run.frames.healthy);
    append_rows(text, run.name, "blind", run.frames.blind);
  }
  return text;
}

std::string internal::calibration_json(const CalibrationResult& result) {
  Json json{{"version", std::string(kVersion)}, {"git", std::string(kGitRevision)}};
  json["chosen"] = name_of(result.normalisation);
  json["fits"] = {json_of(result.plain), json_of(result.per_inlier)};
  for (const CalibrationRun& run : result.runs) {
    json["runs"].push_back({{"name", run.name},
                            {"fingerprint", run.fingerprint},
                            {"healthy", json_of(run.healthy)},
                            {"blind", json_of(run.blind)}});
  }
  return json.dump(2) + "\n";
}

std::string to_table(const CalibrationResult& result) {
  std::string text =
      "| test | rotation [rad^-2] | position [m^-2] | healthy rejected | blind rejected |\n"
      "|---|---|---|---|---|\n";
  text += rows("as they are", result.plain);
  text += rows("per inlier", result.per_inlier);
  text += "\n| run | fingerprint | healthy rejected | blind rejected |\n|---|---|---|---|\n";
  for (const CalibrationRun& run : result.runs) {
    text += fmt::format("| {} | {} | {} |\n", run.name, run.fingerprint,
                        outcome_cells(run.healthy, run.blind));
  }
  return text;
}

std::string to_yaml(const CalibrationResult& result) {
  const FineCalibration& c = result.chosen();
  std::string text = fmt::format(
      "# Thresholds of step 3 by `apvi calibrate` ({}, {}), for camera and IMU in the graph, "
      "from:\n",
      kVersion, kGitRevision);
  for (const CalibrationRun& run : result.runs) {
    text += fmt::format("#   {} {}: {} healthy frames\n", run.name, run.fingerprint,
                        run.healthy.frames);
  }
  text += fmt::format(
      "# Edges of the semicircles: {:.3g} rad^-2, {:.3g} m^-2. Rejected: {:.2f} % of healthy, "
      "{:.1f} % of {} blind frames.\n",
      c.fit.rotation.lower_edge, c.fit.position.lower_edge, 100.0 * c.healthy.rejected,
      100.0 * c.blind.rejected, c.blind.frames);
  text += fmt::format(
      "fusion:\n  discriminator:\n    fine:\n      min_rotation: {:.3g}\n      min_position: "
      "{:.3g}\n      focal_px: {:g}\n      normalisation: {}\n",
      c.thresholds.rotation, c.thresholds.position, fusion::FineConfig{}.focal_px,
      name_of(c.normalisation));
  return text;
}

}  // namespace apvi::pipeline
