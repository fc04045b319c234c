// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <thread>

#include "apvi/core/error.hpp"
#include "apvi/geometry/so3.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/io/tum.hpp"
#include "sim/simulate.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::sim {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// A small, fast scene: coarse seabed, thumbnail images.
constexpr const char* kScene = R"(
seed: 5
duration_s: 2
world: {kind: seabed, depth_m: 6, size_m: 12, resolution_m: 0.3, rocks: 0, marine_life: 0, debris: 0}
water: {snow: {density_per_m3: 20}}
motion: {origin: [-2, 0, -4], length_m: 3, lines: 2, rest_s: 0}
truth: {image_every: 10}
events:
  - {kind: blackout, start_s: 0.5, end_s: 0.8}
rig:
  cam0: {intrinsics: [50, 50, 31.5, 23.5], resolution: [64, 48], rate_hz: 20}
)";

Scene scene(const std::vector<std::string>& overrides = {}) {
  config::Node node = config::parse_yaml(kScene, "scene.yaml");
  for (const std::string& assignment : overrides) config::apply_override(node, assignment);
  return make_scene(node);
}

Scene scene_without_camera(std::vector<std::string> overrides = {}) {
  overrides.emplace_back("camera.enabled=false");
  return scene(overrides);
}

std::string read_bytes(const fs::path& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

std::map<std::string, std::string> tree_of(const fs::path& root) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(root)) {
    if (!entry.is_regular_file()) continue;
    files[fs::relative(entry.path(), root).string()] = read_bytes(entry.path());
  }
  return files;
}

void expect_same_tree(const fs::path& a, const fs::path& b) {
  const auto left = tree_of(a);
  const auto right = tree_of(b);
  ASSERT_EQ(left.size(), right.size());
  for (const auto& [name, bytes] : left) {
    ASSERT_TRUE(right.contains(name)) << name;
    EXPECT_TRUE(right.at(name) == bytes) << name << " differs";
  }
}

std::string error_of(const std::function<void()>& work) {
  try {
    work();
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

struct Counts {
  std::size_t imu = 0, dvl = 0, pressure = 0, depth = 0, images = 0;
  std::size_t dropped = 0;
};

Counts read_back(const fs::path& path) {
  io::DatasetConfig config;
  config.path = path.string();
  const auto reader = io::open_sequence(config, {});
  Counts counts;
  while (const auto event = reader->next()) {
    const std::string_view kind = kind_of(*event);
    counts.imu += kind == "imu";
    counts.dvl += kind == "dvl";
    counts.pressure += kind == "pressure";
    counts.depth += kind == "depth";
    counts.images += kind == "camera";
  }
  for (const auto& [name, stream] : reader->report()) {
    for (const auto& [reason, count] : stream.dropped) counts.dropped += count;
  }
  EXPECT_TRUE(reader->reference());
  return counts;
}

TEST(Dataset, TruthListsWhatIsPlacedByHand) {
  const test::TmpDir dir;
  const fs::path out = dir.path() / "set";
  simulate(scene_without_camera({"world.objects=[{name: wheel, shape: tire, x_m: 3, y_m: 3}]",
                                 "world.recolored=[{name: algae, x_m: -3}]"}),
           out, {});
  const auto json = nlohmann::json::parse(std::ifstream(out / "truth" / "objects.json"));
  ASSERT_EQ(json["objects"].size(), 1U);
  EXPECT_EQ(json["objects"][0]["name"], "wheel");
  EXPECT_NEAR(json["objects"][0]["center"][1].get<double>(), 3.0, 1e-3);
  ASSERT_EQ(json["recolored"].size(), 1U);
  EXPECT_EQ(json["recolored"][0]["name"], "algae");
}

TEST(Dataset, MasksOfFishBelongToEveryImage) {
  const test::TmpDir dir;
  const auto make = [&](const char* name, const std::vector<std::string>& overrides) {
    simulate(scene(overrides), dir.path() / name, {});
    return dir.path() / name;
  };
  const fs::path with = make("with", {"world.fish=[{count: 40, x_m: -1, radius_m: 0.8}]"});
  const fs::path without = make("without", {});
  EXPECT_FALSE(fs::exists(without / "truth" / "moving"));
  std::size_t masks = 0;
  int seen = 0;
  for (const auto& image : fs::directory_iterator(with / "mav0" / "cam0" / "data")) {
    const fs::path file = with / "truth" / "moving" / image.path().filename();
    const cv::Mat mask = cv::imread(file.string(), cv::IMREAD_GRAYSCALE);
    ASSERT_EQ(mask.size(), cv::Size(64, 48)) << file;
    seen += cv::countNonZero(mask == 255);
    ++masks;
  }
  EXPECT_EQ(masks, 41U);
  EXPECT_GT(seen, 0);
  for (const auto& depth : fs::directory_iterator(with / "truth" / "depth")) {
    const fs::path other = without / "truth" / "depth" / depth.path().filename();
    EXPECT_TRUE(read_bytes(depth.path()) == read_bytes(other)) << other;
  }
}

TEST(Dataset, FolderRoundTripKeepsAllSamples) {
  const test::TmpDir dir;
  const fs::path out = dir.path() / "set";
  EXPECT_EQ(simulate(scene(), out, {}), SimulateResult::written);
  const Counts counts = read_back(out);
  EXPECT_EQ(counts.imu, 401U);
  EXPECT_EQ(counts.pressure, 41U);
  EXPECT_EQ(counts.images, 41U);
  EXPECT_GT(counts.dvl, 9U);
  EXPECT_EQ(counts.dropped, 0U);
  EXPECT_FALSE(fs::exists(dir.path() / "set.partial"));
  EXPECT_EQ(simulate(scene(), out, {}), SimulateResult::already_complete);
}

TEST(Dataset, WritesGroundTruth) {
  const test::TmpDir dir;
  const fs::path out = dir.path() / "set";
  simulate(scene(), out, {});
  const fs::path truth = out / "truth";
  EXPECT_EQ(read_bytes(truth / "events.csv"), "start_s,end_s,kind\n0.5,0.8,blackout\n");
  const auto medium = nlohmann::json::parse(read_bytes(truth / "medium.json"));
  for (const char* key : {"beta_d", "beta_b", "b_inf"}) EXPECT_EQ(medium[key].size(), 3U) << key;
  const std::string stamp = "1700000000500000000";  // frame 10, during the blackout
  EXPECT_TRUE(fs::exists(truth / "clear" / (stamp + ".png")));
  const std::string pfm = read_bytes(truth / "depth" / (stamp + ".pfm"));
  EXPECT_EQ(pfm.substr(0, 14), "Pf\n64 48\n-1.0\n");
  ASSERT_EQ(pfm.size(), 14 + sizeof(float) * 64 * 48);
  float depth = 0.0F;  // the bottom right pixel shows the ground 2 m below
  std::memcpy(&depth, pfm.data() + 14 + sizeof(float) * 63, sizeof(float));
  EXPECT_GT(depth, 1.5F);
  EXPECT_LT(depth, 5.0F);
  const cv::Mat dark = cv::imread((out / "mav0/cam0/data" / (stamp + ".png")).string());
  const cv::Mat light = cv::imread((out / "mav0/cam0/data" / "1700000001500000000.png").string());
  EXPECT_LT(cv::mean(dark)[1] + 20.0, cv::mean(light)[1]);
  EXPECT_GT(fs::file_size(truth / "mesh.ply"), 10000U);
}

TEST(Dataset, WritesImagesFromBesideThePathInTheExposureOfTheFrame) {
  const test::TmpDir dir;
  const fs::path out = dir.path() / "set";
  simulate(scene({"truth.off_path.aside_m=0.001", "truth.off_path.turn_deg=0"}), out, {});
  const std::string stamp = "1700000001500000000";
  const fs::path beside = out / "truth" / "off_path";
  const auto json = nlohmann::json::parse(read_bytes(beside / (stamp + ".json")));
  EXPECT_NEAR(std::abs(json["T_camera_view"][3].get<double>()), 0.001, 1e-12);
  cv::Mat there = cv::imread((beside / (stamp + ".png")).string());
  cv::Mat here = cv::imread((out / "mav0/cam0/data" / (stamp + ".png")).string());
  ASSERT_EQ(there.size(), here.size());
  EXPECT_LT(cv::norm(there, here, cv::NORM_L1) / (3.0 * static_cast<double>(here.total())), 4.0);
  EXPECT_GT(cv::norm(there, here, cv::NORM_INF), 0.0) << "the noise is the same";
}

std::uintmax_t image_bytes(const fs::path& data, const char* extension) {
  std::uintmax_t sum = 0;
  for (const auto& entry : fs::directory_iterator(data)) {
    EXPECT_EQ(entry.path().extension(), extension);
    sum += entry.file_size();
  }
  return sum;
}

TEST(Dataset, ACameraThatStoresJpegLeavesJpegFiles) {
  const test::TmpDir dir;
  const auto spectral = [](int quality) {
    Scene made = scene({"physics=spectral", "duration_s=1"});
    made.config.spectral.jpeg_quality = quality;
    return made;
  };
  for (const int quality : {0, 40, 95})
    simulate(spectral(quality), dir.path() / std::to_string(quality), {});
  const auto data = [&](const char* set) { return dir.path() / set / "mav0/cam0/data"; };
  EXPECT_LT(image_bytes(data("40"), ".jpg"), image_bytes(data("95"), ".jpg"));
  EXPECT_LT(image_bytes(data("95"), ".jpg"), image_bytes(data("0"), ".png"));
  EXPECT_EQ(read_back(dir.path() / "95").images, 21U);
}

TEST(Dataset, ClearImagesOfSpectralPhysicsHaveOneExposure) {
  const test::TmpDir dir;
  const fs::path out = dir.path() / "set";
  simulate(scene({"physics=spectral", "truth.image_every=1", "duration_s=1.5"}), out, {});
  const auto brightness = [&](const char* stamp) {
    return cv::mean(cv::imread((out / "truth/clear" / (std::string(stamp) + ".png")).string()))[1];
  };
  // The blackout darkens camera images only for a while, and the clear ones not at all.
  EXPECT_NEAR(brightness("1700000000100000000"), brightness("1700000000200000000"), 10.0);
  EXPECT_GT(brightness("1700000000100000000"), 40.0);
}

TEST(Dataset, OutputIsIndependentOfThreadCount) {
  const test::TmpDir dir;
  simulate(scene(), dir.path() / "one", {.threads = 1});
  simulate(scene(), dir.path() / "three", {.threads = 3});
  expect_same_tree(dir.path() / "one", dir.path() / "three");
}

TEST(Dataset, DifferentSeedsGiveDifferentOutput) {
  const test::TmpDir dir;
  simulate(scene_without_camera(), dir.path() / "a", {});
  simulate(scene_without_camera({"seed=6"}), dir.path() / "b", {});
  const fs::path csv = fs::path("mav0") / "imu0" / "data.csv";
  EXPECT_NE(read_bytes(dir.path() / "a" / csv), read_bytes(dir.path() / "b" / csv));
}

TEST(Dataset, SensorSeedDoesNotChangeTheMotion) {
  const test::TmpDir dir;
  simulate(scene_without_camera(), dir.path() / "a", {});
  simulate(scene_without_camera({"sensor_seed=6"}), dir.path() / "b", {});
  const auto same = [&](const char* sensor) {
    const fs::path csv = fs::path("mav0") / sensor / "data.csv";
    return read_bytes(dir.path() / "a" / csv) == read_bytes(dir.path() / "b" / csv);
  };
  const auto trajectory = [&](const char* name) {
    io::DatasetConfig config;
    config.path = (dir.path() / name).string();
    return io::open_sequence(config, {})->reference().value().poses;
  };
  const auto a = trajectory("a");
  const auto b = trajectory("b");
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(a.back().T_world_body.translation, b.back().T_world_body.translation);
  EXPECT_FALSE(same("imu0"));
  EXPECT_FALSE(same("dvl0"));
}

TEST(Dataset, ResumedSimulationGivesIdenticalOutput) {
  const test::TmpDir dir;
  const fs::path whole = dir.path() / "whole";
  const fs::path stopped = dir.path() / "stopped";
  const fs::path partial = dir.path() / "stopped.partial";
  simulate(scene(), whole, {});
  const fs::path first = partial / "mav0/cam0/data/1700000000100000000.png";
  std::jthread interrupter([&](const std::stop_token& stop) {
    while (!stop.stop_requested() && !fs::exists(first)) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    if (fs::exists(first)) std::raise(SIGINT);
  });
  EXPECT_THROW(simulate(scene(), stopped, {}), RunError);
  EXPECT_FALSE(fs::exists(stopped));
  ASSERT_TRUE(fs::exists(first));
  const auto kept = fs::last_write_time(first);
  simulate(scene(), stopped, {.threads = 2});
  EXPECT_EQ(fs::last_write_time(stopped / "mav0/cam0/data/1700000000100000000.png"), kept);
  expect_same_tree(whole, stopped);
}

TEST(Dataset, EurocAndTankLayoutsRoundTrip) {
  const test::TmpDir dir;
  simulate(scene(), dir.path() / "euroc", {.format = OutputFormat::euroc});
  simulate(scene(), dir.path() / "tank", {.format = OutputFormat::tank});
  EXPECT_FALSE(fs::exists(dir.path() / "euroc" / "rig.yaml"));
  const Counts euroc = read_back(dir.path() / "euroc");
  EXPECT_EQ(euroc.imu, 401U);
  EXPECT_EQ(euroc.images, 41U);
  const Counts tank = read_back(dir.path() / "tank");
  EXPECT_EQ(tank.imu, 401U);
  EXPECT_EQ(tank.images, 41U);
  EXPECT_EQ(tank.depth, 41U);
  EXPECT_GT(tank.dvl, 5U);
}

TEST(Dataset, BagRoundTripsAndIsDeterministic) {
  if (!APVI_WITH_ROSBAG) GTEST_SKIP() << "built without rosbag support";
  const test::TmpDir dir;
  simulate(scene(), dir.path() / "a", {.format = OutputFormat::rosbag, .threads = 1});
  simulate(scene(), dir.path() / "b", {.format = OutputFormat::rosbag, .threads = 2});
  const Counts counts = read_back(dir.path() / "a" / "recording.bag");
  EXPECT_EQ(counts.imu, 401U);
  EXPECT_EQ(counts.depth, 41U);
  EXPECT_EQ(counts.images, 41U);
  EXPECT_GT(counts.dvl, 9U);
  EXPECT_EQ(counts.dropped, 0U);
  expect_same_tree(dir.path() / "a", dir.path() / "b");
}

TEST(Dataset, ColmapModelHasGroundTruthPoses) {
  const test::TmpDir dir;
  const Scene small = scene();
  const fs::path out = dir.path() / "colmap";
  simulate(small, out, {.format = OutputFormat::colmap});
  const Trajectory truth = io::read_trajectory(out / "truth" / "trajectory.tum");
  std::istringstream lines(read_bytes(out / "sparse" / "0" / "images.txt"));
  std::string line;
  std::size_t images = 0;
  while (std::getline(lines, line)) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream words(line);
    std::size_t id = 0;
    double w = 0, x = 0, y = 0, z = 0;
    Eigen::Vector3d t;
    std::size_t camera = 0;
    std::string name;
    words >> id >> w >> x >> y >> z >> t.x() >> t.y() >> t.z() >> camera >> name;
    ASSERT_TRUE(fs::exists(out / "images" / name)) << name;
    const Stamp stamp{std::stoll(name.substr(name.find('/') + 1))};
    const SE3 T_world_camera = SE3{Eigen::Quaterniond(w, x, y, z), t}.inverse();
    const SE3 expected =
        truth.at(stamp, Duration::from_seconds(0.1)).value() * small.rig.cameras[0].T_body_camera;
    EXPECT_LT((T_world_camera.translation - expected.translation).norm(), 1e-6);
    EXPECT_LT(so3::angle_between(T_world_camera.rotation, expected.rotation), 1e-6);
    ++images;
  }
  EXPECT_EQ(images, 41U);
}

TEST(Dataset, RigErrorsPerturbOnlyTheGivenCalibration) {
  const test::TmpDir dir;
  simulate(scene_without_camera({"rig_error.rotation_deg=1", "rig_error.hide_dvl_scale=true"}),
           dir.path() / "a", {});
  const Rig given = make_rig(config::load_file(dir.path() / "a" / "rig.yaml"));
  const Rig truth = make_rig(config::load_file(dir.path() / "a" / "truth" / "rig.yaml"));
  const double angle =
      so3::angle_between(given.dvl->T_body_dvl.rotation, truth.dvl->T_body_dvl.rotation);
  EXPECT_GT(angle, 0.002);
  EXPECT_LT(angle, 0.1);
  EXPECT_EQ(given.dvl->scale, 1.0);
  EXPECT_NEAR(truth.dvl->scale, 1.0 / 1.003, 1e-6);
}

TEST(Dataset, RigContainsTheLampOfTheScene) {
  const test::TmpDir dir;
  simulate(scene_without_camera({"light.lamp={position_m: [0.2, -0.1, 0.05], half_beam_deg: 50}"}),
           dir.path() / "a", {});
  const Rig rig = make_rig(config::load_file(dir.path() / "a" / "rig.yaml"));
  ASSERT_EQ(rig.lamps.size(), 1U);
  EXPECT_NEAR(rig.lamps[0].half_beam_rad, 50.0 * std::numbers::pi / 180.0, 1e-9);
  const SE3 T_body_camera = scene({}).rig.cameras.front().T_body_camera;
  const SE3 T_camera_lamp = T_body_camera.inverse() * rig.lamps[0].T_body_lamp;
  EXPECT_LT((T_camera_lamp.translation - Eigen::Vector3d(0.2, -0.1, 0.05)).norm(), 1e-6);
  EXPECT_LT(so3::angle_between(T_camera_lamp.rotation, Eigen::Quaterniond::Identity()), 1e-6);
  simulate(scene_without_camera({}), dir.path() / "b", {});
  EXPECT_TRUE(make_rig(config::load_file(dir.path() / "b" / "rig.yaml")).lamps.empty());
}

TEST(Dataset, DroppedFramesAreOmitted) {
  const test::TmpDir dir;
  const std::string events = "events=[{kind: dropped_frames, start_s: 0.5, end_s: 1.0}]";
  simulate(scene({events}), dir.path() / "a", {});
  const Counts counts = read_back(dir.path() / "a");
  EXPECT_EQ(counts.images, 31U);
  EXPECT_EQ(counts.dropped, 0U);
}

TEST(Dataset, RejectsInvalidScenes) {
  const auto refused = [](const std::string& assignment) {
    return error_of([&] {
      const test::TmpDir dir;
      simulate(scene_without_camera({assignment}), dir.path() / "set", {});
    });
  };
  EXPECT_THAT(refused("world.kind=moon"), HasSubstr("world.kind"));
  EXPECT_THAT(refused("motion.origin=[-2, 0, -5.9]"), HasSubstr("motion: the path"));
  EXPECT_THAT(refused("motion.origin=[-2, 0, -9]"), HasSubstr("below the ground"));
  EXPECT_THAT(refused("motion.origin=[-2, 0, 1]"), HasSubstr("out of the water"));
  EXPECT_THAT(refused("motion.path=file"), HasSubstr("motion.file"));
  EXPECT_THAT(refused("events=[{kind: blackout, start_s: 5, end_s: 6}]"),
              HasSubstr("after the end of the scene"));
  EXPECT_THAT(refused("sead=3"), HasSubstr("sead"));
  EXPECT_THAT(refused("rig.world=ned"), HasSubstr("z up"));
}

TEST(Dataset, PathThroughTerrainReportsPositionAndWritesNothing) {
  const test::TmpDir dir;
  const std::string message = error_of([&] {
    simulate(
        scene_without_camera({"motion.path=waypoints", "motion.waypoints=[[0, 0, -4], [0, 0, -8]]",
                              "motion.clearance_m=0", "duration_s=20"}),
        dir.path() / "set", {});
  });
  EXPECT_THAT(message, HasSubstr("goes through the terrain at"));
  EXPECT_TRUE(fs::is_empty(dir.path()));
}

TEST(Dataset, NeverOverwritesOtherData) {
  const test::TmpDir dir;
  simulate(scene_without_camera(), dir.path() / "set", {});
  EXPECT_THAT(error_of([&] { simulate(scene_without_camera({"seed=9"}), dir.path() / "set", {}); }),
              HasSubstr("not the dataset of this scene"));
  dir.write("mine/notes.txt", "precious");
  EXPECT_THAT(error_of([&] { simulate(scene_without_camera(), dir.path() / "mine", {}); }),
              HasSubstr("mine"));
  dir.write("file", "");
  EXPECT_THAT(error_of([&] { simulate(scene_without_camera(), dir.path() / "file" / "set", {}); }),
              HasSubstr("cannot create this folder"));
  dir.write("begun.partial/truth/scene.yaml", "another scene");
  EXPECT_THAT(error_of([&] { simulate(scene_without_camera(), dir.path() / "begun", {}); }),
              HasSubstr("belongs to another scene"));
}

}  // namespace
}  // namespace apvi::sim
