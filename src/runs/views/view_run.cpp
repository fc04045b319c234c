// SPDX-License-Identifier: BSD-3-Clause
#include "runs/views/view_run.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <optional>
#include <thread>
#include <vector>

#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "gaussians/detail/detail_levels.hpp"
#include "gaussians/model/point_cloud.hpp"
#include "runs/views/stored_scene.hpp"
#include "slam/camera_conversion.hpp"
#include "viewer/export_page.hpp"
#include "viewer/message.hpp"

namespace apvi::runs {

namespace fs = std::filesystem;

namespace {

using torch::Tensor;

template <std::size_t N>
std::array<float, N> row_of(const Tensor& values, std::int64_t i) {
  std::array<float, N> out{};
  const float* const row = values.data_ptr<float>() + i * static_cast<std::int64_t>(N);
  std::copy_n(row, N, out.begin());
  return out;
}

std::vector<viewer::Splat> splats_of(const gaussians::Gaussians& g) {
  const auto ready = [](const Tensor& t) {
    return t.to(torch::kCPU, torch::kFloat32).contiguous();
  };
  const Tensor means = ready(g.means);
  const Tensor sigmas = ready(g.log_scales.exp());
  const Tensor quaternions = ready(torch::nn::functional::normalize(g.quaternions));
  const Tensor colors = ready(gaussians::sh_dc_to_color(g.sh_dc).clamp_min(0.0));
  const Tensor opacities = ready(g.logit_opacities.sigmoid());
  std::vector<viewer::Splat> splats;
  for (std::int64_t i = 0; i < g.size(); ++i) {
    splats.push_back({row_of<3>(means, i), row_of<3>(sigmas, i), row_of<4>(quaternions, i),
                      row_of<3>(colors, i), opacities.data_ptr<float>()[i]});
  }
  return splats;
}

std::optional<viewer::StaticMap::Water> water_of(const mapping::Map& map) {
  if (!map.medium) return std::nullopt;
  const auto three = [](const Tensor& t) {
    const Tensor v = t.to(torch::kCPU, torch::kFloat64).contiguous();
    return std::array{v[0].item<double>(), v[1].item<double>(), v[2].item<double>()};
  };
  return viewer::StaticMap::Water{three(map.medium->beta_d), three(map.medium->beta_b),
                                  three(map.medium->b_inf)};
}

// In less detail when there are more.
gaussians::Gaussians limited(const gaussians::Gaussians& all, std::int64_t max_gaussians,
                             const fs::path& file) {
  if (all.size() <= max_gaussians) return all;
  const gaussians::Gaussians fewer = gaussians::DetailLevels(all).at_most(max_gaussians);
  log::info("{}: {} Gaussians merged into {}; --max-gaussians sets the limit", file.string(),
            all.size(), fewer.size());
  return fewer;
}

// The whole map from above, for maps without keyframes.
gaussians::View overview(const viewer::SceneDescription& d) {
  const Eigen::Vector3d down = -d.up;
  const Eigen::Quaterniond look =
      Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), down);
  gaussians::View view;
  view.intrinsics = {.fx = 256, .fy = 256, .cx = 160, .cy = 120, .width = 320, .height = 240};
  view.T_camera_world = slam::to_tensor(SE3{look, d.center + 1.5 * d.radius_m * d.up}.inverse());
  return view;
}

}  // namespace

void view_run(const fs::path& source, const viewer::ServerOptions& options,
              const std::function<bool()>& interrupted) {
  StoredScene scene(source, /*with_levels=*/true);
  viewer::Server server(scene, options);
  log::info("open {} in a browser; Ctrl-C ends", server.url());
  // Meanwhile the page is served: a large recording takes minutes to read.
  const std::jthread beams([&](const std::stop_token& stop) {
    if (scene.load_beams([&] { return stop.stop_requested(); })) {
      server.broadcast(viewer::beams_message(*scene.description().beams));
    }
  });
  while (!interrupted()) std::this_thread::sleep_for(std::chrono::milliseconds(50));
}

void export_view(const fs::path& source, const fs::path& file, std::int64_t max_gaussians) {
  StoredScene scene(source, /*with_levels=*/false);
  scene.load_beams([] { return false; });
  const mapping::Map& map = scene.painter().map();
  if (map.medium && map.medium->lamp) {
    log::warning("{}: the lamp of the map is not shown", file.string());
  }
  const gaussians::Gaussians shown = limited(map.gaussians, max_gaussians, file);
  const viewer::StaticMap exported{
      .splats = splats_of(gaussians::with_encoded_colors(shown, map.tone_curve)),
      .water = water_of(map),
      .gains = map.medium ? scene.painter().exposure(overview(scene.description())).gains()
                          : std::array{1.0, 1.0, 1.0},
      .antialiased = map.antialiased};
  io::write_text_file(file, viewer::export_page(scene.description(), exported));
  log::info("{}: {} Gaussians", file.string(), exported.splats.size());
}

}  // namespace apvi::runs
