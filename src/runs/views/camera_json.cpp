// SPDX-License-Identifier: BSD-3-Clause
#include <torch/torch.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "apvi/core/error.hpp"
#include "runs/maps/local_origin.hpp"
#include "runs/views/render_run.hpp"

namespace apvi::runs {
namespace {

using Json = nlohmann::json;

constexpr double kRotationTolerance = 1e-3;  // deviation from orthonormality, for rounded input

torch::Tensor read_matrix(const Json& json, std::int64_t size) {
  const torch::Tensor matrix = torch::empty({size, size}, torch::kFloat64);
  auto m = matrix.accessor<double, 2>();
  for (std::int64_t r = 0; r < size; ++r) {
    for (std::int64_t c = 0; c < size; ++c) {
      m[r][c] = json.at(static_cast<std::size_t>(r)).at(static_cast<std::size_t>(c)).get<double>();
    }
  }
  return matrix;
}

gaussians::View to_view(const Json& json, const map_io::Origin& origin) {
  const torch::Tensor K = read_matrix(json.at("K"), 3);
  const auto k = K.accessor<double, 2>();
  const double shift = 0.5 - json.value("pixel_center", 0.5);
  gaussians::View view;
  view.intrinsics = {.fx = k[0][0],
                     .fy = k[1][1],
                     .cx = k[0][2] + shift,
                     .cy = k[1][2] + shift,
                     .width = json.at("width").get<int>(),
                     .height = json.at("height").get<int>()};
  view.T_camera_world = json.contains("T_cam_world")
                            ? to_local(read_matrix(json.at("T_cam_world"), 4), origin)
                            : torch::eye(4, torch::kFloat64);
  return view;
}

void check(const gaussians::View& view, const std::string& file) {
  const gaussians::Intrinsics& k = view.intrinsics;
  if (k.width < 1 || k.height < 1 || !(k.fx > 0.0) || !(k.fy > 0.0)) {
    fail_input("{}: width, height and the focal lengths in K must be positive", file);
  }
  const torch::Tensor R = view.T_camera_world.slice(0, 0, 3).slice(1, 0, 3);
  const torch::Tensor error = (R.mm(R.t()) - torch::eye(3, torch::kFloat64)).abs().max();
  if (!(error.item<double>() < kRotationTolerance) || !(torch::det(R).item<double>() > 0.0)) {
    fail_input("{}: T_cam_world: not a rigid transform", file);
  }
}

}  // namespace

gaussians::View read_camera_json(const std::filesystem::path& path, const map_io::Origin& origin) {
  std::ifstream in(path);
  if (!in) fail_input("{}: cannot be read; does the file exist?", path.string());
  try {
    const gaussians::View view = to_view(Json::parse(in), origin);
    check(view, path.string());
    return view;
  } catch (const Json::exception& e) {
    fail_input("{}: expected width, height, K (3 x 3) and T_cam_world (4 x 4): {}", path.string(),
               e.what());
  }
}

}  // namespace apvi::runs
