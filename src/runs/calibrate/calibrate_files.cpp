// SPDX-License-Identifier: BSD-3-Clause
#include "runs/calibrate/calibrate_files.hpp"

#include <fmt/format.h>

#include <iterator>
#include <nlohmann/json.hpp>

#include "apvi/version.hpp"
#include "runs/calibrate/calibrate.hpp"

namespace apvi::runs {
namespace {

using Json = nlohmann::ordered_json;
using fusion::DegeneracyCalibration;
using fusion::EigenThresholds;
using fusion::Normalization;
using fusion::RecordedFrame;
using fusion::Semicircle;
using fusion::ThresholdOutcome;

const char* name_of(Normalization normalization) {
  return normalization == Normalization::none ? "none" : "per_inlier";
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

Json json_of(const ThresholdOutcome& outcome) {
  return {{"frames", outcome.frames},
          {"rejected", outcome.rejected},
          {"rejected_by_remap", outcome.rejected_by_remap},
          {"directions", outcome.directions}};
}

Json json_of(const DegeneracyCalibration& c) {
  return {{"normalization", name_of(c.normalization)},
          {"rotation", json_of(c.fit.rotation, c.thresholds.rotation)},
          {"position", json_of(c.fit.position, c.thresholds.position)},
          {"healthy", json_of(c.healthy)},
          {"blind", json_of(c.blind)},
          {"healthy_at_edge", json_of(c.healthy_at_edge)},
          {"blind_at_edge", json_of(c.blind_at_edge)}};
}

std::string outcome_cells(const ThresholdOutcome& healthy, const ThresholdOutcome& blind) {
  return fmt::format("{:.2f} % of {} | {:.1f} % of {}", 100.0 * healthy.rejected, healthy.frames,
                     100.0 * blind.rejected, blind.frames);
}

std::string row(const std::string& name, const EigenThresholds& thresholds,
                const ThresholdOutcome& healthy, const ThresholdOutcome& blind) {
  return fmt::format("| {} | {:.3g} | {:.3g} | {} |\n", name, thresholds.rotation,
                     thresholds.position, outcome_cells(healthy, blind));
}

// With remapping, a frame is rejected when too few directions remain.
ThresholdOutcome remap_outcome(ThresholdOutcome outcome) {
  outcome.rejected = outcome.rejected_by_remap;
  return outcome;
}

std::string rows(const std::string& name, const DegeneracyCalibration& c) {
  const std::string remap =
      fmt::format("{}, remapped ({:.2f} directions kept; blind frames {:.2f})", name,
                  c.healthy.directions, c.blind.directions);
  return row(name + ", edges of the fit", c.fit.thresholds(), c.healthy_at_edge, c.blind_at_edge) +
         row(name + ", thresholds", c.thresholds, c.healthy, c.blind) +
         row(remap, c.thresholds, remap_outcome(c.healthy), remap_outcome(c.blind));
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
  json["chosen"] = name_of(result.normalization);
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
  const DegeneracyCalibration& c = result.chosen();
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
      "fusion:\n  discriminator:\n    degeneracy:\n      min_rotation_eigenvalue: {:.3g}\n"
      "      min_position_eigenvalue: {:.3g}\n      reference_focal_px: {:g}\n"
      "      normalization: {}\n",
      c.thresholds.rotation, c.thresholds.position,
      fusion::DegeneracyCheckConfig{}.reference_focal_px, name_of(c.normalization));
  return text;
}

}  // namespace apvi::runs
