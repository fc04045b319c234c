// SPDX-License-Identifier: BSD-3-Clause
#include "importer/colmap_model.hpp"

#include <cmath>
#include <fstream>
#include <iterator>

#include "apvi/core/error.hpp"
#include "apvi/sensors/lens.hpp"
#include "importer/colmap_numbers.hpp"

namespace apvi::importer {
namespace {

namespace fs = std::filesystem;

std::vector<std::uint8_t> read_bytes(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) fail_input("{}: cannot be read; check its permissions", path.string());
  return {std::istreambuf_iterator<char>(in), {}};
}

// The file STEM.bin, else STEM.txt.
template <typename Binary, typename Text>
auto read_part(const fs::path& stem, const Binary& binary, const Text& text) {
  const std::string bin = stem.string() + ".bin";
  if (fs::exists(bin)) return binary(read_bytes(bin), bin);
  const std::string txt = stem.string() + ".txt";
  std::ifstream in(txt);
  if (!in) fail_input("{}: missing; a COLMAP model has cameras and images", txt);
  return text(in, txt);
}

// Where parameters of a model are.
struct Layout {
  const char* name;
  std::size_t count;
  bool one_focal_length;
  Distortion distortion;
};

constexpr std::array<Layout, 9> kLayouts = {
    {{"SIMPLE_PINHOLE", 3, true, Distortion::none},
     {"PINHOLE", 4, false, Distortion::none},
     {"SIMPLE_RADIAL", 4, true, Distortion::radtan},
     {"RADIAL", 5, true, Distortion::radtan},
     {"OPENCV", 8, false, Distortion::radtan},
     {"FULL_OPENCV", 12, false, Distortion::radtan},
     {"OPENCV_FISHEYE", 8, false, Distortion::equidistant},
     {"SIMPLE_RADIAL_FISHEYE", 4, true, Distortion::equidistant},
     {"RADIAL_FISHEYE", 5, true, Distortion::equidistant}}};

[[noreturn]] void fail_unsupported(const ColmapCamera& camera, const std::string& name) {
  fail_input(
      "{}: camera model {} is not supported; use OPENCV, OPENCV_FISHEYE, or undistort the images "
      "with `colmap image_undistorter`",
      name, camera.model);
}

const Layout& layout_of(const ColmapCamera& camera, const std::string& name) {
  for (const Layout& layout : kLayouts) {
    if (camera.model != layout.name) continue;
    if (camera.parameters.size() == layout.count) return layout;
    fail_input("{}: {} has {} parameters, got {}", name, camera.model, layout.count,
               camera.parameters.size());
  }
  fail_unsupported(camera, name);
}

}  // namespace

SE3 to_pose(const std::array<double, 7>& pose, const std::string& where) {
  const Eigen::Quaterniond q(pose[0], pose[1], pose[2], pose[3]);
  const Eigen::Vector3d t(pose[4], pose[5], pose[6]);
  if (!t.allFinite() || !(std::abs(q.norm() - 1.0) < 0.02)) {
    fail_input("{}: the pose is not finite or its quaternion not of norm 1", where);
  }
  return {q.normalized(), t};
}

ColmapModel read_colmap_model(const fs::path& folder) {
  ColmapModel model;
  model.cameras = read_part(folder / "cameras", parse_cameras_bin, parse_cameras_txt);
  model.images = read_part(folder / "images", parse_images_bin, parse_images_txt);
  const fs::path points = folder / "points3D";
  if (fs::exists(points.string() + ".bin") || fs::exists(points.string() + ".txt")) {
    model.points = read_part(points, parse_points_bin, parse_points_txt);
  }
  return model;
}

CameraModel::Parameters to_camera(const ColmapCamera& camera, const std::string& name) {
  const Layout& layout = layout_of(camera, name);
  constexpr std::uint64_t kMaxSide = 100'000;
  const bool sized = camera.width > 0 && camera.height > 0 && camera.width <= kMaxSide &&
                     camera.height <= kMaxSide;
  std::size_t next = 0;
  CameraModel::Parameters p;
  p.fx = camera.parameters[next++];
  p.fy = layout.one_focal_length ? p.fx : camera.parameters[next++];
  p.cx = camera.parameters[next++] - 0.5;
  p.cy = camera.parameters[next++] - 0.5;
  if (!sized || !(p.fx > 0.0 && p.fy > 0.0)) {
    fail_input("{}: a camera of {} x {} with focal length {}", name, camera.width, camera.height,
               p.fx);
  }
  p.width = static_cast<int>(camera.width);
  p.height = static_cast<int>(camera.height);
  p.distortion = layout.distortion;
  for (std::size_t i = 0; next < layout.count && i < p.coefficients.size(); ++i) {
    p.coefficients[i] = camera.parameters[next++];
  }
  if (const auto problem = lens_problem(p)) fail_input("{}: {}", name, *problem);
  return p;
}

}  // namespace apvi::importer
