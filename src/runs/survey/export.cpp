// SPDX-License-Identifier: BSD-3-Clause
#include "runs/survey/export.hpp"

#include <fmt/format.h>
#include <torch/torch.h>

#include <Eigen/Core>
#include <iterator>
#include <nlohmann/json.hpp>
#include <string>
#include <system_error>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/io/tum.hpp"
#include "gaussians/model/point_cloud.hpp"
#include "runs/maps/posed_images.hpp"
#include "runs/views/image_files.hpp"
#include "slam/camera_conversion.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using torch::Tensor;

void make_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) fail_run("{}: cannot create folder: {}", folder.string(), error.message());
}

void write_images(const fs::path& folder, const mapping::KeyframeStore& keyframes) {
  make_folder(folder);
  for (std::size_t i = 0; i < keyframes.size(); ++i) {
    write_png(folder / (keyframes[i].name + ".png"), keyframes.pixels(i));
  }
}

Tensor color_bytes(const gaussians::Gaussians& map) {
  const Tensor color =
      gaussians::sh_dc_to_color(map.sh_dc.detach().to(torch::kCPU, torch::kFloat32));
  return (color.clamp(0.0, 1.0) * 255.0).round().to(torch::kInt64).contiguous();
}

std::string colmap_cameras(const mapping::KeyframeStore& keyframes) {
  const gaussians::Intrinsics& k = keyframes[0].intrinsics;
  return fmt::format(
      "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n1 PINHOLE {} {} {:.9g} {:.9g} {:.9g} {:.9g}\n",
      k.width, k.height, k.fx, k.fy, k.cx, k.cy);
}

std::string colmap_images(const mapping::KeyframeStore& keyframes) {
  std::string text = "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of points\n";
  for (std::size_t i = 0; i < keyframes.size(); ++i) {
    const SE3 T = slam::to_se3(keyframes[i].T_camera_world);
    const auto& q = T.rotation;
    const Eigen::Vector3d t = T.translation + Eigen::Vector3d::Zero();  // no -0
    fmt::format_to(std::back_inserter(text),
                   "{} {:.12g} {:.12g} {:.12g} {:.12g} {:.9g} {:.9g} {:.9g} 1 {}.png\n\n", i + 1,
                   q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z(), keyframes[i].name);
  }
  return text;
}

std::string colmap_points(const gaussians::Gaussians& map) {
  const Tensor means = map.means.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  const Tensor colors = color_bytes(map);
  const float* x = means.data_ptr<float>();
  const std::int64_t* c = colors.data_ptr<std::int64_t>();
  std::string text = "# POINT3D_ID X Y Z R G B ERROR TRACK[]\n";
  for (std::int64_t i = 0; i < map.size(); ++i, x += 3, c += 3) {
    fmt::format_to(std::back_inserter(text), "{} {:.7g} {:.7g} {:.7g} {} {} {} 0\n", i + 1, x[0],
                   x[1], x[2], c[0], c[1], c[2]);
  }
  return text;
}

// ASCII, which every reader of transforms.json supports.
std::string points_ply(const gaussians::Gaussians& map) {
  const Tensor means = map.means.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  const Tensor colors = color_bytes(map);
  const float* x = means.data_ptr<float>();
  const std::int64_t* c = colors.data_ptr<std::int64_t>();
  std::string text = fmt::format(
      "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty "
      "float "
      "z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
      map.size());
  for (std::int64_t i = 0; i < map.size(); ++i, x += 3, c += 3) {
    fmt::format_to(std::back_inserter(text), "{:.7g} {:.7g} {:.7g} {} {} {}\n", x[0], x[1], x[2],
                   c[0], c[1], c[2]);
  }
  return text;
}

nlohmann::ordered_json opengl_matrix(const Tensor& T_camera_world) {
  Eigen::Matrix4d m = slam::to_se3(T_camera_world).inverse().matrix();
  m.col(1) *= -1.0;
  m.col(2) *= -1.0;
  auto rows = nlohmann::ordered_json::array();
  for (int r = 0; r < 4; ++r) rows.push_back({m(r, 0), m(r, 1), m(r, 2), m(r, 3)});
  return rows;
}

void require_keyframes(const mapping::KeyframeStore& keyframes) {
  if (keyframes.size() == 0) fail_input("export: no keyframes");
}

}  // namespace

void export_colmap(const fs::path& folder, const mapping::KeyframeStore& keyframes,
                   const map_io::MapFile& file) {
  require_keyframes(keyframes);
  const gaussians::Gaussians map = gaussians::with_encoded_colors(file.gaussians, file.tone_curve);
  const fs::path model = folder / "sparse" / "0";
  make_folder(model);
  io::write_text_file(model / "cameras.txt", colmap_cameras(keyframes));
  io::write_text_file(model / "images.txt", colmap_images(keyframes));
  io::write_text_file(model / "points3D.txt", colmap_points(map));
  write_images(folder / "images", keyframes);
  map_io::write_origin_json(folder / "origin.json", file.origin);
}

void export_nerfstudio(const fs::path& folder, const mapping::KeyframeStore& keyframes,
                       const map_io::MapFile& file) {
  require_keyframes(keyframes);
  const gaussians::Gaussians map = gaussians::with_encoded_colors(file.gaussians, file.tone_curve);
  write_images(folder / "images", keyframes);
  const gaussians::Intrinsics& k = keyframes[0].intrinsics;
  nlohmann::ordered_json json = {{"camera_model", "OPENCV"},
                                 {"fl_x", k.fx},
                                 {"fl_y", k.fy},
                                 {"cx", k.cx},
                                 {"cy", k.cy},
                                 {"w", k.width},
                                 {"h", k.height},
                                 {"k1", 0.0},
                                 {"k2", 0.0},
                                 {"p1", 0.0},
                                 {"p2", 0.0},
                                 {"ply_file_path", "points.ply"},
                                 {"frames", nlohmann::ordered_json::array()}};
  for (std::size_t i = 0; i < keyframes.size(); ++i) {
    json["frames"].push_back({{"file_path", "images/" + keyframes[i].name + ".png"},
                              {"transform_matrix", opengl_matrix(keyframes[i].T_camera_world)}});
  }
  io::write_text_file(folder / "points.ply", points_ply(map));
  io::write_text_file(folder / "transforms.json", json.dump(1) + "\n");
  map_io::write_origin_json(folder / "origin.json", file.origin);
}

FinishedRun load_finished_run(const fs::path& folder) {
  for (const char* needed : {"map.ply", "resolved.yaml", "keyframes.tum"}) {
    if (fs::exists(folder / needed)) continue;
    fail_input("{}: missing; is this a mapping run folder?", (folder / needed).string());
  }
  RunConfig config = load_recorded_run_config(folder / "resolved.yaml");
  config.localization.poses_file = (folder / "keyframes.tum").string();
  FinishedRun run{.map = load_map(folder), .keyframes = mapping::KeyframeStore()};
  run.keyframes = load_posed_images(config, {.origin = run.map.origin}).store;
  return run;
}

map_io::MapFile load_map(const fs::path& source) {
  if (!fs::is_directory(source)) return map_io::read_map(source);
  if (!fs::exists(source / "map.ply")) {
    fail_input("{}: missing; is this a mapping run folder?", (source / "map.ply").string());
  }
  map_io::MapFile map = map_io::read_map(source / "map.ply");
  if (fs::exists(source / "resolved.yaml")) {
    map.antialiased =
        load_recorded_run_config(source / "resolved.yaml").mapping.trainer.antialiased;
  }
  return map;
}

}  // namespace apvi::runs
