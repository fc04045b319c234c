// SPDX-License-Identifier: BSD-3-Clause
#include "runs/maps/mapping_run.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "apvi/core/error.hpp"
#include "apvi/io/tum.hpp"
#include "eval/metrics_file.hpp"
#include "map_io/map_file.hpp"
#include "map_io/ply.hpp"
#include "runs/maps/local_origin.hpp"
#include "runs/quality/patch_colors.hpp"
#include "runs/survey/export.hpp"
#include "runs/views/image_files.hpp"
#include "runs/views/render_run.hpp"
#include "slam/camera_conversion.hpp"
#include "support/out_of_memory.hpp"
#include "support/posed_scene.hpp"
#include "support/tmp_dir.hpp"
#include "support/wall_recording.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class MappingRunTest : public testing::Test {
 protected:
  RunConfig config(int iterations) const { return test::wall_config(data_, iterations); }
  fs::path run_folder() const { return data_.path() / "run"; }
  MappingRunOptions options() const { return {.folder = run_folder()}; }

  /// Moves the poses and the initial points from zero to UTM coordinates.
  RunConfig move_to_utm(int iterations) {
    io::write_euroc(data_.path() / test::kWallPoses, to_recording(poses_, kUtm));
    const gaussians::Gaussians wall = test::gaussian_wall();
    const torch::Tensor colors = 255.0 * gaussians::sh_dc_to_color(wall.sh_dc).clamp(0.0, 1.0);
    std::string text;
    for (std::int64_t i = 0; i < wall.size(); ++i) {
      text += std::to_string(i);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto k = static_cast<std::int64_t>(axis);
        text += fmt::format(" {:.6f}", kUtm[axis] + wall.means[i][k].item<double>());
      }
      for (std::int64_t c = 0; c < 3; ++c)
        text += fmt::format(" {:.3f}", colors[i][c].item<float>());
      text += " 0\n";
    }
    RunConfig moved = config(iterations);
    moved.mapping.initial_points = data_.write("points3D.txt", text).string();
    return moved;
  }

  static constexpr map_io::Origin kUtm = {596000.0, 6640000.0, 0.0};

  test::TmpDir data_;
  Trajectory poses_ = test::write_wall_recording(data_, test::gaussian_wall());
};

TEST_F(MappingRunTest, WritesAllRunFiles) {
  const MappingRunResult result = run_mapping(config(200), options());
  EXPECT_EQ(result.iterations, 200);
  EXPECT_GT(result.psnr_db, 19.0);
  const eval::Json metrics = eval::read_metrics(run_folder() / "metrics.json");
  EXPECT_EQ(metrics["mapping"]["heldout_views"], 3);
  EXPECT_DOUBLE_EQ(metrics["mapping"]["psnr_db"].get<double>(), result.psnr_db);
  EXPECT_GT(metrics["mapping"]["ssim"].get<double>(), 0.5);
  EXPECT_FALSE(metrics["mapping"].contains("ms_ssim"));  // the images are too small for it
  for (const char* file : {"map.ply", "keyframes.tum", "resolved.yaml", "log.txt", "mapping.csv",
                           "checkpoint.pt", "renders/1000000000_truth.png",
                           "renders/1000000000_render.png", "renders/1000000000_depth.png"}) {
    EXPECT_TRUE(fs::exists(run_folder() / file)) << file;
  }
  EXPECT_FALSE(fs::exists(run_folder() / "medium.json"));
  EXPECT_EQ(map_io::read_ply(run_folder() / "map.ply").size(), result.gaussians);
}

TEST_F(MappingRunTest, RestoredImagesAreComparedUpToOneFactorPerChannel) {
  const mapping::KeyframeStore images = test::render_keyframes(test::gaussian_wall());
  const torch::Tensor factors = torch::tensor({0.5, 1.0, 0.8});
  for (std::size_t i = 0; i < images.size(); ++i) {
    const torch::Tensor clear = (images[i].image * factors).round().to(torch::kUInt8);
    cv::imwrite(data_.write("truth/clear/" + images[i].name + ".png", "").string(),
                slam::to_image(clear));
  }
  run_mapping(config(200), options());
  const eval::Json absolute =
      eval::read_metrics(run_folder() / "metrics.json").value("mapping", eval::Json());
  EXPECT_FALSE(absolute.contains("restored_factors"));
  data_.write("truth/camera.json", "{}");  // as spectral physics leaves it
  run_mapping(config(200), {.folder = run_folder(), .overwrite = true});
  const eval::Json relative =
      eval::read_metrics(run_folder() / "metrics.json").value("mapping", eval::Json());
  for (std::size_t c = 0; c < 3; ++c) {
    EXPECT_NEAR(relative["restored_factors"][c].get<double>(),
                factors[static_cast<std::int64_t>(c)].item<double>(), 0.03);
  }
  EXPECT_GT(relative["restored_psnr_db"].get<double>(), 18.0);
  EXPECT_GT(relative["restored_psnr_db"].get<double>(),
            absolute["restored_psnr_db"].get<double>() + 3.0);
}

TEST_F(MappingRunTest, PatchesOfTheImagesHaveTheColorsOfTheMap) {
  RunConfig with_curve = config(200);
  with_curve.mapping.trainer.tone_curve.kind = mapping::ToneCurveKind::srgb;
  run_mapping(with_curve, options());
  const mapping::KeyframeStore images = test::render_keyframes(test::gaussian_wall());
  std::vector<Patch> patches;
  for (const std::size_t i : {0U, 3U, 8U}) {
    const torch::Tensor region = images[i].image.slice(0, 10, 20).slice(1, 12, 24);
    const torch::Tensor light = gaussians::kSrgb.decode(region.to(torch::kFloat64) / 255.0);
    const torch::Tensor mean = light.reshape({-1, 3}).mean(0);
    patches.push_back(
        {.stamp_ns = images[i].stamp_ns,
         .rectangle = {12, 10, 12, 10},
         .reference = {mean[0].item<double>(), mean[1].item<double>(), mean[2].item<double>()}});
  }
  patches.push_back({.stamp_ns = 17, .rectangle = {0, 0, 4, 4}, .reference = {1.0, 1.0, 1.0}});
  const std::vector<PatchColor> measured = measure_patches(run_folder(), patches);
  ASSERT_EQ(measured.size(), 3U);  // the recording has no image 17
  const PatchErrors errors = errors_of(measured);
  EXPECT_NEAR(errors.image_deg, 0.0, 1e-3);
  EXPECT_LT(*errors.restored_balanced_deg, 4.0);
  patches.erase(patches.begin(), patches.begin() + 3);
  EXPECT_THROW(measure_patches(run_folder(), patches), InputError);
}

TEST_F(MappingRunTest, MetricsReportReducedGaussianLimit) {
  APVI_SKIP_ON_GPU();
  map_io::write_ply(data_.path() / "points.ply", test::gaussian_wall(1500));
  test::OutOfMemoryAllocator memory;
  MappingRunOptions ends = options();
  ends.interrupted = [&memory, steps = 0]() mutable {
    if (++steps == 20) memory.fail_after(0);
    return false;
  };
  const MappingRunResult result = run_mapping(config(60), ends);
  EXPECT_EQ(result.iterations, 60);
  EXPECT_EQ(result.gaussians, 1200);
  EXPECT_EQ(eval::read_metrics(run_folder() / "metrics.json")["mapping"]["reduced_max_gaussians"],
            1200);
}

TEST_F(MappingRunTest, ResumedTrainingGivesSameMap) {
  run_mapping(config(40), {.folder = data_.path() / "whole"});
  int steps = 0;
  MappingRunOptions interrupted = options();
  interrupted.interrupted = [&steps] { return ++steps == 17; };
  const MappingRunResult half = run_mapping(config(40), interrupted);
  EXPECT_TRUE(half.interrupted);
  EXPECT_EQ(half.iterations, 17);
  EXPECT_TRUE(fs::exists(run_folder() / "map.ply"));
  MappingRunOptions resume = options();
  resume.resume = true;
  EXPECT_EQ(run_mapping(config(40), resume).iterations, 40);
  EXPECT_TRUE(torch::equal(map_io::read_ply(run_folder() / "map.ply").means,
                           map_io::read_ply(data_.path() / "whole/map.ply").means));
}

TEST_F(MappingRunTest, WritesMediumFile) {
  RunConfig with_water = config(10);
  with_water.mapping.medium = true;
  run_mapping(with_water, options());
  EXPECT_TRUE(fs::exists(run_folder() / "medium.json"));
  EXPECT_TRUE(map_io::read_ply_medium(run_folder() / "map.ply"));
  EXPECT_TRUE(eval::read_metrics(run_folder() / "metrics.json").contains("medium"));
  EXPECT_TRUE(fs::exists(run_folder() / "renders/1000000000_restored.png"));
}

TEST_F(MappingRunTest, RefusesToOverwriteRun) {
  run_mapping(config(1), options());
  EXPECT_THROW(run_mapping(config(1), options()), InputError);
  MappingRunOptions overwrite = options();
  overwrite.overwrite = true;
  EXPECT_NO_THROW(run_mapping(config(1), overwrite));
}

// Without gain compensation, so that rendered and held-out images have the same exposure.
TEST_F(MappingRunTest, RendersRunFromItsKeyframes) {
  RunConfig one_exposure = config(30);
  one_exposure.mapping.trainer.gain_compensation = false;
  run_mapping(one_exposure, options());
  const fs::path out = data_.path() / "out";
  EXPECT_EQ(render_run({.source = run_folder(), .out = out, .depth = true}), 9U);
  const cv::Mat drawn = cv::imread((out / "1000000000.png").string());
  const cv::Mat kept = cv::imread((run_folder() / "renders/1000000000_render.png").string());
  EXPECT_EQ(cv::norm(drawn, kept, cv::NORM_INF), 0.0);
  const cv::Mat depth = cv::imread((out / "5000000000_depth.png").string(), cv::IMREAD_UNCHANGED);
  EXPECT_NEAR(depth.at<std::uint16_t>(16, 24), 3000, 400);  // [mm]
}

TEST_F(MappingRunTest, ExposureOfRestoredImagesIsAFactor) {
  RunConfig with_water = config(10);
  with_water.mapping.medium = true;
  run_mapping(with_water, options());
  EXPECT_EQ(eval::read_metrics(run_folder() / "metrics.json")["mapping"]["restored_gain"].size(),
            3U);
  const auto restored = [&](double exposure, ImageFormat format) {
    const char* const extension = format == ImageFormat::pfm ? "pfm" : "png";
    const fs::path out = data_.path() / fmt::format("out_{}_{}", exposure, extension);
    render_run({.source = run_folder(),
                .out = out,
                .restore = true,
                .format = format,
                .bits = 16,
                .exposure = exposure,
                .white_balance = false});
    return cv::imread((out / fmt::format("1000000000_restored.{}", extension)).string(),
                      cv::IMREAD_UNCHANGED);
  };
  const cv::Mat once = restored(1.0, ImageFormat::pfm);
  const cv::Mat twice = restored(2.0, ImageFormat::pfm);
  EXPECT_LT(cv::norm(2.0 * once, twice, cv::NORM_INF), 1e-5);
  const cv::Mat png = restored(1e-3, ImageFormat::png);
  ASSERT_EQ(png.type(), CV_16UC3);
  cv::Mat linear;
  png.convertTo(linear, CV_32F, 1e3 / 65535.0);
  EXPECT_LT(cv::norm(linear, once, cv::NORM_INF), 0.01);  // dark: not compressed
}

TEST_F(MappingRunTest, RendersMapFileFromCameraFile) {
  const fs::path camera = data_.write("camera.json",
                                      "{\"width\": 48, \"height\": 32, \"K\": "
                                      "[[40,0,23.5],[0,40,15.5],[0,0,1]], \"pixel_center\": 0}");
  const fs::path out = data_.path() / "out";
  const auto rendered = [&](ImageFormat format, const char* name) {
    render_run({.source = data_.path() / "points.ply",
                .camera = camera,
                .out = out,
                .depth = true,
                .format = format});
    return cv::imread((out / name).string(), cv::IMREAD_UNCHANGED);
  };
  const cv::Mat image = rendered(ImageFormat::pfm, "points.pfm");
  gaussians::View view;
  view.intrinsics = test::small_camera();
  view.T_camera_world = torch::eye(4, torch::kFloat64);
  const torch::Tensor expected = gaussians::render(test::gaussian_wall(), view, {}).color;
  EXPECT_NEAR(image.at<cv::Vec3f>(3, 5)[2], expected[3][5][0].item<float>(), 1e-5);
  EXPECT_NEAR(image.at<cv::Vec3f>(30, 40)[0], expected[30][40][2].item<float>(), 1e-5);
  const cv::Mat exr = rendered(ImageFormat::exr, "points.exr");
  ASSERT_EQ(exr.type(), CV_32FC3);
  EXPECT_EQ(cv::norm(exr, image, cv::NORM_INF), 0.0);  // a map file without a tone curve
  const cv::Mat depth = cv::imread((out / "points_depth.exr").string(), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(depth.type(), CV_32FC1);
  EXPECT_NEAR(depth.at<float>(16, 24), 3.0F, 0.4F);
  EXPECT_THROW(render_run({.source = data_.path() / "points.ply", .out = out}), InputError);
}

TEST_F(MappingRunTest, RejectsInvalidCameraFiles) {
  EXPECT_THROW(read_camera_json(data_.write("c.json", "{}")), InputError);
  EXPECT_THROW(read_camera_json(data_.write("c.json", "nonsense")), InputError);
  EXPECT_THROW(
      read_camera_json(data_.write(
          "c.json",
          "{\"width\": 4, \"height\": 4, \"K\": [[1,0,1],[0,1,1],[0,0,1]], \"T_cam_world\": "
          "[[2,0,0,0],[0,2,0,0],[0,0,2,0],[0,0,0,1]]}")),
      InputError);
  EXPECT_THROW(read_camera_json(data_.path() / "missing.json"), InputError);
}

TEST_F(MappingRunTest, ExportsColmapModelOfInputs) {
  run_mapping(config(1), options());
  const FinishedRun run = load_finished_run(run_folder());
  export_colmap(data_.path() / "colmap", run.keyframes, run.map);
  std::ifstream images(data_.path() / "colmap/sparse/0/images.txt");
  std::string line;
  std::getline(images, line);
  std::getline(images, line);
  EXPECT_EQ(line, "1 1 0 0 0 0.4 0.3 0 1 1000000000.png");
  std::ifstream cameras(data_.path() / "colmap/sparse/0/cameras.txt");
  std::getline(cameras, line);
  std::getline(cameras, line);
  EXPECT_EQ(line, "1 PINHOLE 48 32 40 40 24 16");
  EXPECT_TRUE(fs::exists(data_.path() / "colmap/images/9000000000.png"));
}

TEST_F(MappingRunTest, ExportsNerfstudioWithOpenGlAxes) {
  run_mapping(config(1), options());
  const FinishedRun run = load_finished_run(run_folder());
  export_nerfstudio(data_.path() / "ns", run.keyframes, run.map);
  std::ifstream in(data_.path() / "ns/transforms.json");
  const auto json = nlohmann::json::parse(in);
  EXPECT_EQ(json["frames"].size(), 9U);
  const auto& m = json["frames"][0]["transform_matrix"];
  EXPECT_DOUBLE_EQ(m[0][3].get<double>(), -0.4);
  EXPECT_DOUBLE_EQ(m[1][1].get<double>(), -1.0);
  EXPECT_DOUBLE_EQ(m[2][2].get<double>(), -1.0);
  EXPECT_EQ(map_io::read_ply_points(data_.path() / "ns/points.ply").positions.size(0), 400);
}

TEST_F(MappingRunTest, PosesInUtmGiveTheMapOfPosesNearZero) {
  const RunConfig utm = move_to_utm(200);
  const MappingRunResult result = run_mapping(utm, options());
  EXPECT_GT(result.psnr_db, 19.0);
  const map_io::MapFile map = map_io::read_map(run_folder() / "map.ply");
  EXPECT_EQ(map.origin, kUtm);
  EXPECT_LT(map.gaussians.means.abs().max().item<float>(), 10.0F);
  EXPECT_TRUE(fs::exists(run_folder() / "origin.json"));
  const Trajectory keyframes = io::read_trajectory(run_folder() / "keyframes.tum");
  ASSERT_EQ(keyframes.size(), poses_.size());
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    const Eigen::Vector3d local =
        keyframes.poses[i].T_world_body.translation - Eigen::Vector3d(kUtm[0], kUtm[1], kUtm[2]);
    EXPECT_LT((local - poses_.poses[i].T_world_body.translation).norm(), 0.1);
  }
}

TEST_F(MappingRunTest, RendersMapInUtmFromPosesInUtm) {
  RunConfig one_exposure = move_to_utm(30);
  one_exposure.mapping.trainer.gain_compensation = false;
  run_mapping(one_exposure, options());
  const fs::path out = data_.path() / "out";
  EXPECT_EQ(render_run({.source = run_folder(), .out = out}), 9U);
  const cv::Mat drawn = cv::imread((out / "1000000000.png").string());
  const cv::Mat kept = cv::imread((run_folder() / "renders/1000000000_render.png").string());
  EXPECT_LE(cv::norm(drawn, kept, cv::NORM_INF), 1.0);
  const Trajectory keyframes = io::read_trajectory(run_folder() / "keyframes.tum");
  const Eigen::Matrix4d T = keyframes.poses[0].T_world_body.inverse().matrix();
  nlohmann::json json = {{"width", 48}, {"height", 32}};
  json["K"] = {{40, 0, 24}, {0, 40, 16}, {0, 0, 1}};
  for (int r = 0; r < 4; ++r) json["T_cam_world"].push_back({T(r, 0), T(r, 1), T(r, 2), T(r, 3)});
  const fs::path file = data_.write("camera.json", json.dump());
  render_run({.source = run_folder() / "map.ply", .camera = file, .out = out});
  EXPECT_LE(cv::norm(cv::imread((out / "map.png").string()), kept, cv::NORM_INF), 1.0);
}

TEST_F(MappingRunTest, ExportsOfMapInUtmAreLocalWithOrigin) {
  run_mapping(move_to_utm(1), options());
  const FinishedRun run = load_finished_run(run_folder());
  EXPECT_EQ(run.map.origin, kUtm);
  export_colmap(data_.path() / "colmap", run.keyframes, run.map);
  std::ifstream images(data_.path() / "colmap/sparse/0/images.txt");
  std::string line;
  std::getline(images, line);
  double values[8] = {};  // IMAGE_ID QW QX QY QZ TX TY TZ
  for (double& value : values) images >> value;
  EXPECT_NEAR(values[5], 0.4, 1e-6);
  EXPECT_NEAR(values[6], 0.3, 1e-6);
  std::ifstream in(data_.path() / "colmap/origin.json");
  EXPECT_EQ(nlohmann::json::parse(in)["origin_m"].get<map_io::Origin>(), kUtm);
}

TEST_F(MappingRunTest, ExportRejectsFolderWithoutMap) {
  try {
    load_finished_run(data_.path());
    FAIL() << "nothing was thrown";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("map.ply: missing; is this a mapping run folder?"));
  }
}

}  // namespace
}  // namespace apvi::runs
