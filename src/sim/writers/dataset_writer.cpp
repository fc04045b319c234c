// SPDX-License-Identifier: BSD-3-Clause
#include "sim/writers/dataset_writer.hpp"

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <system_error>

#include "apvi/core/error.hpp"
#include "apvi/io/tum.hpp"
#include "io/folder/csv_rows.hpp"
#include "sim/writers/csv_text.hpp"
#include "sim/writers/formats.hpp"

namespace apvi::sim {
namespace {

namespace fs = std::filesystem;
using Triple = std::array<double, 3>;

Trajectory true_trajectory(const ImuRecord& record) {
  Trajectory trajectory;
  for (std::size_t i = 0; i < record.samples.size(); ++i) {
    trajectory.poses.push_back({record.samples[i].stamp, record.truth[i].T_world_body});
  }
  return trajectory;
}

Triple median_of(std::vector<Triple> values) {
  Triple median{};
  for (std::size_t channel = 0; channel < 3; ++channel) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end(),
                     [&](const Triple& a, const Triple& b) { return a[channel] < b[channel]; });
    median[channel] = (*middle)[channel];
  }
  return median;
}

/// One key of the files in truth/medium: the median over the frames, `fallback` without files.
Triple median_of_frames(const fs::path& root, const char* key, const Triple& fallback) {
  const fs::path folder = root / "truth" / "medium";
  std::vector<fs::path> files;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(folder, none)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::vector<Triple> values;
  for (const fs::path& file : files) {
    const auto frame = nlohmann::json::parse(std::ifstream(file), nullptr, false);
    if (frame.contains(key)) values.push_back(frame[key].get<Triple>());
  }
  return values.empty() ? fallback : median_of(std::move(values));
}

// The veiling light is in image units: the median over the frames, since their gain varies.
void write_medium(const fs::path& root, const SceneConfig& scene) {
  const Medium medium = make_medium(scene.water);
  const auto triple = [](const Eigen::Vector3d& v) { return Triple{v.x(), v.y(), v.z()}; };
  const nlohmann::ordered_json json = {
      {"beta_d", triple(medium.beta_d)},
      {"beta_b", triple(medium.beta_b)},
      {"b_inf", median_of_frames(root, "b_inf", triple(medium.b_inf))}};
  write_file(root / "truth" / "medium.json", json.dump(2) + "\n");
}

// Without frames there is nothing to fit the effective coefficients to.
void write_effective_medium(const fs::path& root) {
  if (!fs::exists(root / "truth" / "medium")) return;
  nlohmann::ordered_json json;
  for (const char* key : {"beta_d", "beta_b", "b_inf"})
    json[key] = median_of_frames(root, key, Triple{});
  json["effective"] = true;
  write_file(root / "truth" / "medium.json", json.dump(2) + "\n");
}

void write_camera(const fs::path& root, const SceneConfig& scene) {
  constexpr int kSteps = 64;
  nlohmann::ordered_json curve;
  for (int i = 0; i <= kSteps; ++i)
    curve.push_back(
        tone(scene.spectral.tone, scene.camera.effects.gamma, static_cast<double>(i) / kSteps));
  const nlohmann::ordered_json json = {{"tone_curve", curve}};
  write_file(root / "truth" / "camera.json", json.dump() + "\n");
}

}  // namespace

void write_file(const fs::path& path, const std::string& content) {
  std::error_code error;
  fs::create_directories(path.parent_path(), error);
  if (error)
    fail_run("{}: cannot create this folder: {}", path.parent_path().string(), error.message());
  io::write_text_file(path, content);
}

std::string_view image_extension(const SceneConfig& config) {
  return config.physics == Physics::spectral && config.spectral.jpeg_quality > 0 ? ".jpg" : ".png";
}

fs::path image_path(const fs::path& root, OutputFormat format, std::size_t camera, Stamp stamp,
                    std::string_view extension) {
  const std::string name = fmt::format("{}{}", stamp.ns, extension);
  switch (format) {
    case OutputFormat::folder:
    case OutputFormat::euroc:
      return root / "mav0" / fmt::format("cam{}", camera) / "data" / name;
    case OutputFormat::tank:
      return root / (camera == 0 ? "IMG_L" : "IMG_R") / name;
    case OutputFormat::colmap:
      return root / "images" / fmt::format("cam{}", camera) / name;
    case OutputFormat::rosbag:
      return root / "frames" / fmt::format("cam{}", camera) / name;
  }
  return {};
}

void write_recording(const fs::path& root, OutputFormat format, const Scene& scene,
                     const Recording& recording) {
  switch (format) {
    case OutputFormat::folder:
      return write_folder(root, scene, recording);
    case OutputFormat::euroc:
      return write_euroc(root, scene, recording);
    case OutputFormat::tank:
      return write_tank(root, scene, recording);
    case OutputFormat::colmap:
      return write_colmap(root, scene, recording);
    case OutputFormat::rosbag:
      return write_bag(root, scene, recording);
  }
}

void write_exposures(const fs::path& root, const Scene& scene, const Recording& recording,
                     const std::vector<Development>& exposures) {
  if (exposures.empty()) return;
  write_file(root / "mav0" / "exposure0" / "data.csv",
             exposure_csv(recording.frames, exposures, scene.config.camera.effects.exposure_s));
}

void write_truth(const fs::path& root, const Scene& scene, const EventSchedule& events,
                 const Recording& recording, const TriangleMesh& mesh) {
  const fs::path truth = root / "truth";
  write_file(truth / "rig.yaml", config::to_yaml(scene.rig_node) + "\n");
  write_file(truth / "events.csv", to_csv(events));
  io::write_tum(truth / "trajectory.tum", true_trajectory(recording.imu));
  if (scene.config.physics == Physics::spectral) {
    write_effective_medium(root);
    write_camera(root, scene.config);
  } else {
    write_medium(root, scene.config);
  }
  write_file(truth / "objects.json", objects_json(scene.config.world, scene.seed(), mesh));
  if (scene.config.truth.mesh) write_ply(mesh, truth / "mesh.ply");
}

void write_folder(const fs::path& root, const Scene& scene, const Recording& recording) {
  const fs::path mav = root / "mav0";
  write_file(root / "rig.yaml", config::to_yaml(perturbed_rig(scene)) + "\n");
  if (scene.rig.imu) {
    write_file(mav / "imu0" / "data.csv", imu_csv(recording.imu.samples, io::kImuCsvHeader));
  }
  if (scene.rig.dvl) write_file(mav / "dvl0" / "data.csv", dvl_csv(recording.dvl));
  if (scene.rig.pressure) {
    write_file(mav / "pressure0" / "data.csv", pressure_csv(recording.pressure));
  } else if (scene.rig.depth) {
    write_file(mav / "depth0" / "data.csv", depth_csv(recording.depth));
  }
  for (std::size_t i = 0; i < scene.rig.cameras.size(); ++i) {
    write_file(mav / fmt::format("cam{}", i) / "data.csv",
               camera_csv(recording.frames, io::kImageCsvHeader, image_extension(scene.config)));
  }
  write_file(mav / "state_groundtruth_estimate0" / "data.csv",
             truth_csv(recording.imu, kTruthHeader));
}

}  // namespace apvi::sim
