// SPDX-License-Identifier: BSD-3-Clause
#include "runs/calibrate/calibrate.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

#include "apvi/core/constants.hpp"
#include "apvi/core/error.hpp"
#include "runs/health_file.hpp"
#include "support/source_dir.hpp"
#include "support/test_data.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using fusion::Normalization;
using test::TmpDir;

constexpr const char* kHeader =
    "#timestamp [ns],state,level,vio,landmarks,rotation_eigenvalue_1 [rad^-2],"
    "rotation_eigenvalue_2 [rad^-2],rotation_eigenvalue_3 [rad^-2],position_eigenvalue_1 [m^-2],"
    "position_eigenvalue_2 [m^-2],position_eigenvalue_3 [m^-2]\n";

std::string line(int k, const char* level, const char* vio, int landmarks, double size) {
  const double s = size * (1.0 + 0.01 * (k % 50));
  return fmt::format("{},fused,{},{},{},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g},{:.6g}\n", k, level, vio,
                     landmarks, 100 * s, 200 * s, 300 * s, s, 2 * s, 3 * s);
}

// A finished run with 200 healthy frames, 20 rejected by step 2, and 30 blind ones.
fs::path write_run(const TmpDir& tmp, const std::string& name, double size,
                   const std::string& degeneracy = "action: ignore") {
  std::string health = kHeader;
  for (int k = 0; k < 200; ++k) health += line(k, "accepted", "tracking", 100, size);
  for (int k = 0; k < 20; ++k) health += line(k, "medium", "tracking", 100, 1e-3);
  for (int k = 0; k < 30; ++k) health += line(k, "input", "blind", 0, 0.01 * size);
  tmp.write(name + "/health.csv", health);
  tmp.write(name + "/resolved.yaml",
            "vio: {graph: paper}\nfusion: {discriminator: {degeneracy: {" + degeneracy + "}}}\n");
  return tmp.path() / name;
}

TEST(Calibrate, LoadsHealthyAndBlindFramesOfFinishedRuns) {
  const TmpDir tmp;
  const fs::path run = write_run(tmp, "run", 1000.0);
  const fusion::RecordedFrames frames = recorded_frames(run);
  EXPECT_EQ(frames.healthy.size(), 200U);
  EXPECT_EQ(frames.blind.size(), 30U);
  EXPECT_NEAR(frames.healthy[0].eigenvalues.rotation(0), 1e5, 1e-6);
  EXPECT_EQ(frames.healthy[0].inliers, 100);
}

TEST(Calibrate, UndoesPerInlierNormalizationOfTheRun) {
  const TmpDir tmp;
  const fs::path run = write_run(tmp, "run", 10.0, "normalization: per_inlier");
  EXPECT_NEAR(recorded_frames(run).healthy[0].eigenvalues.position(0), 1000.0, 1e-9);
}

TEST(Calibrate, ScalesEigenvaluesToReferenceFocalLength) {
  const TmpDir tmp;
  const fs::path run = write_run(tmp, "run", 1000.0);
  const auto camera = [&](double f) {
    tmp.write(
        "run/resolved.yaml",
        fmt::format("vio: {{graph: paper}}\nrig:\n  cam0: {{model: pinhole, intrinsics: [{}, {}, "
                    "160, 120], resolution: [320, 240]}}\n",
                    f, f));
    return recorded_frames(run).healthy[0].eigenvalues;
  };
  const double focal = fusion::DegeneracyCheckConfig{}.reference_focal_px;
  EXPECT_NEAR(camera(focal).rotation(0), 1e5, 1e-6);
  EXPECT_NEAR(camera(0.5 * focal).rotation(0), 4e5, 1e-6);
  EXPECT_NEAR(camera(2.0 * focal).position(0), 250.0, 1e-9);
}

TEST(Calibrate, WritesThresholdsThatConfigurationsInherit) {
  const TmpDir tmp;
  CalibrateOptions options;
  options.inputs = {write_run(tmp, "near", 1000.0), write_run(tmp, "far", 2000.0)};
  options.folder = tmp.path() / "calibration";
  const CalibrationResult result = calibrate(options);
  EXPECT_LE(result.plain.healthy.rejected, 0.01);
  EXPECT_EQ(result.plain.blind.rejected, 1.0);
  const fs::path file = tmp.write("mine.yaml", "inherit: calibration/thresholds.yaml\n");
  const fusion::DegeneracyCheckConfig degeneracy =
      load_run_config(file, {}).fusion.discriminator.degeneracy;
  EXPECT_NEAR(degeneracy.min_rotation_eigenvalue, result.plain.thresholds.rotation,
              1e-2 * degeneracy.min_rotation_eigenvalue);
  EXPECT_NEAR(degeneracy.min_position_eigenvalue, result.plain.thresholds.position,
              1e-2 * degeneracy.min_position_eigenvalue);
  for (const CalibrationRun& run : result.runs) {
    EXPECT_THAT(to_yaml(result), testing::HasSubstr(run.name + " " + run.fingerprint));
  }
  for (const char* name : {"calibration.json", "eigenvalues.csv"}) {
    EXPECT_GT(fs::file_size(options.folder / name), 500U) << name;
  }
}

TEST(Calibrate, FingerprintDependsOnContentNotOnPath) {
  const TmpDir tmp;
  const auto fingerprint = [&](const fs::path& run) {
    CalibrateOptions options;
    options.inputs = {run};
    options.folder = tmp.path() / "calibration";
    return calibrate(options).runs[0].fingerprint;
  };
  const std::string here = fingerprint(write_run(tmp, "here", 1000.0));
  EXPECT_EQ(fingerprint(write_run(tmp, "there", 1000.0)), here);
  EXPECT_NE(fingerprint(write_run(tmp, "other", 1001.0)), here);
  EXPECT_NE(fingerprint(write_run(tmp, "set", 1000.0, "min_directions: 4")), here);
}

TEST(Calibrate, WritesNormalizationOfPerInlierThresholds) {
  const TmpDir tmp;
  CalibrateOptions options;
  options.inputs = {write_run(tmp, "run", 1000.0)};
  options.folder = tmp.path() / "calibration";
  options.normalization = Normalization::per_inlier;
  const CalibrationResult result = calibrate(options);
  const fusion::DegeneracyCheckConfig degeneracy =
      load_run_config(options.folder / "thresholds.yaml", {}).fusion.discriminator.degeneracy;
  EXPECT_EQ(degeneracy.normalization, Normalization::per_inlier);
  EXPECT_NEAR(degeneracy.min_position_eigenvalue, 0.01 * result.plain.thresholds.position,
              0.01 * degeneracy.min_position_eigenvalue);
}

TEST(Calibrate, RejectsUnusableInputs) {
  const TmpDir tmp;
  CalibrateOptions options;
  options.folder = tmp.path() / "calibration";
  EXPECT_THROW(calibrate(options), InputError);
  options.inputs = {tmp.path() / "nothing"};
  EXPECT_THROW(calibrate(options), InputError);  // not a run, and no configuration given
  tmp.write("dark/health.csv", kHeader + line(0, "input", "blind", 0, 1.0));
  tmp.write("dark/resolved.yaml", "vio: {graph: paper}\n");
  options.inputs = {tmp.path() / "dark"};
  EXPECT_THROW(calibrate(options), RunError);
}

TEST(HealthFile, ReportsLineNumberOfInvalidLine) {
  const TmpDir tmp;
  const fs::path file =
      tmp.write("health.csv", std::string(kHeader) + "1,fused,accepted,tracking,few\n");
  try {
    read_health(file);
    FAIL() << "no exception";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), testing::HasSubstr("health.csv:2"));
  }
  EXPECT_THROW(read_health(tmp.write("other.csv", "#timestamp [ns],p_x [m]\n1,2\n")), InputError);
  EXPECT_THROW(read_health(tmp.path() / "absent.csv"), InputError);
}

TEST(Calibrate, ThresholdsFromRealRecordingAcceptIt) {
  APVI_NEEDS_DATA(dataset, "euroc_mh01_apvi");
  const TmpDir tmp;
  CalibrateOptions options;
  options.inputs = {dataset};
  options.config = test::source_dir() / "configs/datasets/euroc_apvi.yaml";
  options.folder = tmp.path() / "calibration";
  const CalibrationResult result = calibrate(options);
  EXPECT_GT(result.plain.healthy.frames, 200U);
  EXPECT_LE(result.plain.healthy.rejected, 0.01);
  const double sigma = 1.0 / std::sqrt(result.plain.thresholds.rotation);  // that is let pass
  EXPECT_LT(sigma, 0.15 * kRadiansPerDegree);
  EXPECT_TRUE(fs::exists(options.folder / "runs" / "euroc_mh01_apvi-dark" / "health.csv"));
}

}  // namespace
}  // namespace apvi::runs
