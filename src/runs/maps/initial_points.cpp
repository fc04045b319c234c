// SPDX-License-Identifier: BSD-3-Clause
#include "runs/maps/initial_points.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <fstream>
#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/text.hpp"
#include "mapping/density/gaussian_limit.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

constexpr double kBoxMargin = 0.5;         // of the diagonal: cameras look outward
constexpr std::size_t kColmapColumns = 7;  // up to the color; the error is unused

gaussians::PointCloud to_cloud(std::vector<float> positions, std::vector<float> colors) {
  const auto n = static_cast<std::int64_t>(positions.size() / 3);
  return {.positions = torch::from_blob(positions.data(), {n, 3}).clone(),
          .colors = torch::from_blob(colors.data(), {n, 3}).clone() / 255.0};
}

mapping::Box configured_box(const RunConfig& config, const mapping::KeyframeStore& store,
                            const map_io::Origin& o) {
  const auto& b = config.mapping.initial_box_m;
  if (b.empty()) return camera_box(store, kBoxMargin);
  return {.low = {b[0] - o[0], b[1] - o[1], b[2] - o[2]},
          .high = {b[3] - o[0], b[4] - o[1], b[5] - o[2]}};
}

gaussians::PointCloud read_points(const fs::path& path, const map_io::Origin& origin) {
  if (!fs::exists(path)) {
    fail_input("mapping.initial_points: {}: not sift, not random, and no such file", path.string());
  }
  const std::string extension = text::to_lower(path.extension().string());
  if (extension == ".ply") return map_io::read_ply_points(path, origin);
  if (extension == ".txt") return read_colmap_points(path, origin);
  fail_input("mapping.initial_points: {}: expected a .ply file or COLMAP's points3D.txt",
             path.string());
}

}  // namespace

gaussians::PointCloud read_colmap_points(const fs::path& path, const map_io::Origin& origin) {
  std::ifstream in(path);
  if (!in) fail_input("{}: cannot be read", path.string());
  std::vector<float> positions;
  std::vector<float> colors;
  std::vector<std::string_view> words;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    const std::string_view content = text::trim(line);
    if (content.empty() || content.front() == '#') continue;
    text::split(content, ' ', words);
    if (words.size() < kColmapColumns) {
      fail_input("{}:{}: expected POINT3D_ID X Y Z R G B ERROR", path.string(), number);
    }
    for (std::size_t i = 1; i < kColmapColumns; ++i) {
      const auto value = text::parse_double(words[i]);
      if (!value || !std::isfinite(*value)) {
        fail_input("{}:{}: \"{:.40}\" is not a number", path.string(), number, words[i]);
      }
      if (i < 4) {
        positions.push_back(static_cast<float>(*value - origin[i - 1]));
      } else {
        colors.push_back(static_cast<float>(*value));
      }
    }
  }
  return to_cloud(std::move(positions), std::move(colors));
}

mapping::Box camera_box(const mapping::KeyframeStore& store, double margin) {
  std::vector<torch::Tensor> centers;
  for (const std::size_t i : store.training()) {
    centers.push_back(mapping::camera_center(store[i].T_camera_world));
  }
  const torch::Tensor all = torch::stack(centers);
  const torch::Tensor low = std::get<0>(all.min(0));
  const torch::Tensor high = std::get<0>(all.max(0));
  const double grow = std::max(1.0, margin * (high - low).norm().item<double>());
  mapping::Box box;
  for (std::int64_t axis = 0; axis < 3; ++axis) {
    const auto i = static_cast<std::size_t>(axis);
    box.low[i] = low[axis].item<double>() - grow;
    box.high[i] = high[axis].item<double>() + grow;
  }
  return box;
}

gaussians::PointCloud initial_points(const RunConfig& config, const mapping::KeyframeStore& store,
                                     const map_io::Origin& origin) {
  const std::string& source = config.mapping.initial_points;
  gaussians::PointCloud points;
  if (source == "random") {
    points = mapping::random_points(configured_box(config, store, origin),
                                    config.mapping.initial_random_points,
                                    static_cast<std::uint64_t>(config.run.seed));
  } else if (source == "sift") {
    points = triangulate_points(store);
  } else {
    points = read_points(source, origin);
  }
  const std::int64_t count = points.positions.size(0);
  if (count == 0) {
    fail_input("mapping.initial_points: {}: no points; try random", source);
  }
  log::info("{} initial points ({})", count, source);
  const std::int64_t most = mapping::gaussian_limit(config.mapping.trainer.densify);
  if (count <= most) return points;
  log::warning("mapping.max_gaussians: {}: using every {}th of the {} initial points", most,
               (count + most - 1) / most, count);
  const torch::Tensor kept = torch::arange(0, count, (count + most - 1) / most);
  return {.positions = points.positions.index({kept}), .colors = points.colors.index({kept})};
}

}  // namespace apvi::runs
