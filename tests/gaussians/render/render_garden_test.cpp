// SPDX-License-Identifier: BSD-3-Clause
// Compares renderings of a real scene with those of an independent rasterizer.
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>

#include "gaussians/render/raster_backend.hpp"
#include "gaussians/render/render.hpp"
#include "map_io/ply.hpp"
#include "support/test_data.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

/// A float image [H,W,C], top row first; the file stores rows bottom up.
Tensor read_pfm(const std::filesystem::path& path, std::int64_t channels) {
  std::ifstream in(path, std::ios::binary);
  std::string magic;
  std::int64_t width = 0;
  std::int64_t height = 0;
  double scale = 0.0;
  in >> magic >> width >> height >> scale;
  in.get();
  Tensor image = torch::empty({height, width, channels});
  in.read(static_cast<char*>(image.data_ptr()), image.numel() * 4);
  EXPECT_TRUE(in.good()) << path;
  return image.flip(0);
}

double psnr_db(const Tensor& a, const Tensor& b) {
  const double mse = (a.to(torch::kFloat64) - b.to(torch::kFloat64)).square().mean().item<double>();
  return -10.0 * std::log10(mse);
}

/// The camera of the reference images.
View garden_view() {
  return {.intrinsics = {.fx = 474.6788635253906,
                         .fy = 550.3366088867188,
                         .cx = 320.1851806640625,
                         .cy = 240.07144165039062,
                         .width = 640,
                         .height = 480},
          .T_camera_world =
              torch::tensor(
                  {0.2752179205417633, -0.961380660533905, -0.0015191672137007117,
                   -0.025438308715820312, -0.2117573767900467, -0.059079013764858246,
                   -0.975534975528717, 0.22704041004180908, 0.9377707242965698, 0.2688063979148865,
                   -0.21983905136585236, 1.195468783378601, 0.0, 0.0, 0.0, 1.0},
                  torch::kFloat64)
                  .reshape({4, 4}),
          .pose_delta = {}};
}

std::vector<const RasterBackend*> available_backends() {
  std::vector<const RasterBackend*> out = cpu_raster_backends();
#if APVI_WITH_CUDA
  if (torch::cuda::is_available()) out.push_back(&cuda_raster_backend());
#endif
  return out;
}

TEST(Garden, MatchesIndependentRasterizer) {
  APVI_NEEDS_DATA(data, "splat_reference");
  const Gaussians garden = map_io::read_ply(data / "garden.ply");
  const View view = garden_view();
  const Tensor color = read_pfm(data / "garden_rgb.pfm", 3);
  const Tensor alpha = read_pfm(data / "garden_alpha.pfm", 1).squeeze(-1);
  for (const RasterBackend* backend : available_backends()) {
    const auto device = backend->name() == "cuda" ? torch::kCUDA : torch::kCPU;
    Gaussians moved;
    for (std::size_t i = 0; i < 6; ++i) *moved.tensors()[i] = garden.tensors()[i]->to(device);
    const RasterOutput drawn = backend->forward({.gaussians = moved,
                                                 .background = torch::zeros({3}, device),
                                                 .T_camera_world = view.T_camera_world,
                                                 .intrinsics = view.intrinsics,
                                                 .sh_degree = 0,
                                                 .near_m = 0.01,
                                                 .low_pass_px2 = 0.3,
                                                 .antialiased = false});
    const double psnr = psnr_db(drawn.color.cpu(), color);
    std::printf("%s: %.1f dB\n", std::string(backend->name()).c_str(), psnr);
    EXPECT_GE(psnr, 75.0) << backend->name();
    EXPECT_GE(psnr_db(drawn.alpha.cpu(), alpha), 75.0) << backend->name();
  }
}

TEST(Garden, FloatMatchesDouble) {
  APVI_NEEDS_DATA(data, "splat_reference");
  const Gaussians garden = map_io::read_ply(data / "garden.ply");
  Gaussians exact;
  for (std::size_t i = 0; i < 6; ++i)
    *exact.tensors()[i] = garden.tensors()[i]->to(torch::kFloat64);
  const View view = garden_view();
  EXPECT_GE(psnr_db(render(garden, view, {}).color, render(exact, view, {}).color), 75.0);
}

}  // namespace
}  // namespace apvi::gaussians
