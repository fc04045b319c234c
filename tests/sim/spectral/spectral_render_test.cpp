// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <numbers>

#include "apvi/core/error.hpp"
#include "sim/render/renderer.hpp"
#include "sim/scene_config.hpp"
#include "sim/spectral/backscatter_grid.hpp"
#include "sim/spectral/light_field.hpp"
#include "sim/spectral/phase_function.hpp"
#include "sim/spectral/spectral_shading.hpp"
#include "sim/world/world.hpp"
#include "support/source_dir.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

CameraModel small_camera() {
  return CameraModel({.fx = 60,
                      .fy = 60,
                      .cx = 31.5,
                      .cy = 23.5,
                      .distortion = Distortion::none,
                      .coefficients = {},
                      .width = 64,
                      .height = 48});
}

// Camera that looks straight down.
SE3 looking_down(const Vector3d& position) {
  return {Eigen::Quaterniond(Eigen::AngleAxisd(std::numbers::pi, Vector3d::UnitX())), position};
}

// A level square of 40 m at height z.
TriangleMesh plane(float z) {
  TriangleMesh mesh;
  mesh.add_vertex({-20, -20, z});
  mesh.add_vertex({20, -20, z});
  mesh.add_vertex({20, 20, z});
  mesh.add_vertex({-20, 20, z});
  mesh.add_quad(0, 1, 2, 3, Material::plain);
  return mesh;
}

ImageRequest still(const SE3& T_world_camera) {
  ImageRequest request;
  request.T_world_camera = [T_world_camera](Stamp) { return T_world_camera; };
  return request;
}

constexpr std::size_t kBand = 7;

// The sea of a water with light in one band only, so that closed forms exist.
struct OneBand {
  explicit OneBand(const std::vector<SpectralLampConfig>& lamps = {}, double direct = 0.0)
      : sea({.type = JerlovType::C1, .attenuation_length_m = std::nullopt},
            {.direct_fraction = direct}, {.lamps = lamps}),
        state(sea.state({}, 0.0)) {
    for (std::size_t k = 0; k < kBands; ++k) {
      if (k == kBand) continue;
      state.total[k] = state.sun[k] = 0.0F;
      for (SpectrumF& lamp : state.lamps) lamp[k] = 0.0F;
    }
  }
  double green() const { return sea.sensor().response[1][kBand]; }

  Sea sea;
  SeaState state;
};

TEST(SpectralShading, ObeysBeerAndLambertInOneBand) {
  const OneBand one;
  const SpectralLight light{.sea = &one.sea, .state = one.state};
  TileSurface surface;
  surface.clear();
  surface.p.count = kBatch;
  for (Lanes* lanes : {&surface.r, &surface.g, &surface.b, &surface.sky}) lanes->fill(1.0F);
  for (int i = 0; i < kBatch; ++i) {
    surface.range[i] = 0.05F * static_cast<float>(i);
    surface.p.z[i] = -2.0F;
  }
  TileRays tile;
  Lanes blurred[3] = {};
  shade_spectral(light, surface, tile, blurred);
  const double leaving =
      one.green() * one.state.total[kBand] * std::exp(-2.0 * one.state.diffuse[kBand]);
  for (int i = 0; i < kBatch; i += 15) {
    const double r = surface.range[i];
    const double sharp = leaving * std::exp(-r * one.state.sharp[kBand]);
    const double smooth = leaving * std::exp(-r * one.state.smooth[kBand]);
    EXPECT_NEAR(tile.clear[1][i], leaving, 1e-4 * leaving);
    EXPECT_NEAR(tile.observed[1][i], sharp, 1e-4 * leaving);
    EXPECT_NEAR(tile.observed[1][i] + blurred[1][i], smooth, 1e-4 * leaving);
  }
}

// Backscatter of diffuse daylight along a ray that goes down: pi b G E exp(-K depth)
// (1 - exp(-q r)) / q with q = smooth + K.
TEST(BackscatterGrid, OfDaylightIsTheClosedForm) {
  const TriangleMesh mesh = plane(-60.0F);
  const RayCaster world(mesh);
  const OneBand one;
  const Lens lens = make_lens(small_camera(), std::nullopt);
  const BackscatterGrid light(lens, 4, looking_down({0, 0, -5}), one.sea, one.state, {}, world);
  const double k_d = one.state.diffuse[kBand];
  const double q = one.state.smooth[kBand] + k_d;
  const double source = std::numbers::pi * one.state.scatter[kBand] * diffuse_scatter().at(-1.0F) *
                        one.state.total[kBand] * std::exp(-5.0 * k_d) * one.green();
  for (const float r : {0.2F, 1.0F, 3.0F, 8.0F, 20.0F}) {
    const double expected = source * (1.0 - std::exp(-q * r)) / q;
    EXPECT_NEAR(light.at(32, 24, r)[1], expected, 0.015 * expected) << r;
  }
}

TEST(BackscatterGrid, OfALampIsTheIntegral) {
  const TriangleMesh mesh = plane(-60.0F);
  const RayCaster world(mesh);
  const SpectralLampConfig lamp{.intensity = 2.0, .position_m = {0.3, -0.1, 0.0}, .spill = 0.0};
  const OneBand one({lamp});
  const Lens lens = make_lens(small_camera(), std::nullopt);
  const SE3 pose = looking_down({0, 0, -30});
  OneBand dark = one;
  dark.state.total[kBand] = 0.0F;
  const BackscatterGrid light(lens, 4, pose, one.sea, dark.state, one.sea.lamp_poses(pose), world);
  const FournierForand phase;
  const Vector3d view = lens.rays[lens.index(32, 24)].cast<double>();
  for (const double range : {0.4, 1.0, 2.5, 6.0}) {
    constexpr int kSteps = 4000;
    double sum = 0.0;
    for (int i = 0; i < kSteps; ++i) {
      const double t = range * (i + 0.5) / kSteps;
      const Vector3d ray = t * view - Vector3d(0.3, -0.1, 0.0);
      const double d = ray.norm();
      const double angle = std::acos(ray.z() / d);
      const double lobe =
          std::exp(-std::numbers::ln2 * std::pow(angle / (std::numbers::pi / 3.0), lamp.edge));
      sum += lobe * phase.value(-ray.dot(view) / d) / (d * d) *
             std::exp(-one.state.smooth[kBand] * (d + t)) * range / kSteps;
    }
    const double expected =
        std::numbers::pi * one.state.scatter[kBand] * one.state.lamps[0][kBand] * sum * one.green();
    EXPECT_NEAR(light.at(32, 24, static_cast<float>(range))[1], expected, 0.03 * expected) << range;
  }
}

TEST(BackscatterGrid, IsDarkerWhereTheSceneHidesTheSun) {
  const RayCaster open(plane(-60.0F));
  const RayCaster covered(plane(-2.0F));
  const OneBand one({}, 0.8);
  const Lens lens = make_lens(small_camera(), std::nullopt);
  const SE3 pose = looking_down({0, 0, -5});
  const BackscatterGrid lit(lens, 8, pose, one.sea, one.state, {}, open);
  const BackscatterGrid shaded(lens, 8, pose, one.sea, one.state, {}, covered);
  EXPECT_LT(shaded.at(32, 24, 4.0F)[1], 0.95F * lit.at(32, 24, 4.0F)[1]);
}

RendererConfig spectral_config() {
  RendererConfig config;
  config.physics = Physics::spectral;
  config.water.type = JerlovType::IB;
  config.water.attenuation_length_m = std::nullopt;
  config.water.reference_depth_m = 8.5;
  config.camera.target_mean = 0.2;
  config.camera.max_gain = 200.0;
  config.spectral.white_balance = WhiteBalance::preset;
  return config;
}

TEST(SpectralRenderer, WhiteBalancedGrayCardIsGray) {
  const TriangleMesh mesh = plane(-8.5F);
  const RayCaster world(mesh);
  RendererConfig config = spectral_config();
  config.camera.noise = false;
  config.water.snow.density_per_m3 = 0.0;
  const Renderer renderer(mesh, world, small_camera(), config, 3);
  const cv::Mat image = renderer.render(still(looking_down({0, 0, -7}))).image;
  const auto pixel = image.at<cv::Vec3b>(24, 32);
  EXPECT_NEAR(pixel[0], pixel[1], 10);
  EXPECT_NEAR(pixel[2], pixel[1], 10);
  EXPECT_GT(pixel[1], 60);
}

TEST(SpectralRenderer, DoesNotDependOnThreads) {
  const TriangleMesh mesh = make_world({.depth_m = 9, .size_m = 10, .resolution_m = 0.2}, 3);
  const RayCaster world(mesh);
  RendererConfig config = spectral_config();
  config.spectral.lamps = {SpectralLampConfig{}};
  config.light.caustics = 0.3;
  const Renderer renderer(mesh, world, small_camera(), config, 3);
  const ImageRequest request = still(looking_down({0, 0, -7}));
  const RenderedFrame one = renderer.render(request, 1);
  const RenderedFrame three = renderer.render(request, 3);
  ASSERT_EQ(one.image.size(), cv::Size(64, 48));
  EXPECT_EQ(std::memcmp(one.image.data, three.image.data, std::size_t{64} * 48 * 3), 0);
  EXPECT_EQ(std::memcmp(one.clear.data, three.clear.data, std::size_t{64} * 48 * 3), 0);
}

Scene scene_of(const std::string& text) {
  return make_scene(config::parse_yaml(text, "scene.yaml"));
}

TEST(SpectralScene, RejectsKeysOfTheOtherPhysics) {
  EXPECT_THROW(scene_of("physics: spectral\nlight: {lamp: {}}"), InputError);
  EXPECT_THROW(scene_of("physics: spectral\nwater: {beta_d: [1, 1, 1]}"), InputError);
  EXPECT_THROW(scene_of("physics: spectral\nspectral: {lamps: [{}, {}, {}]}"), InputError);
  EXPECT_THROW(scene_of("spectral: {lamps: [{}]}"), InputError);
  const Scene two = scene_of("physics: spectral\nspectral: {lamps: [{}, {intensity: 3}]}");
  ASSERT_EQ(two.rig.lamps.size(), 2U);
  EXPECT_EQ(two.rig.lamps[1].intensity, 3.0);
}

TEST(SpectralScene, TestScenesAreThreeByDayAndThreeByLamp) {
  for (const std::string place : {"reef", "wreck", "dam"}) {
    for (const std::string light : {"day", "lamp"}) {
      const Scene scene =
          load_scene(test::source_dir() / "configs/scenes/test" / (place + "_" + light + ".yaml"));
      EXPECT_EQ(scene.config.physics, Physics::spectral);
      EXPECT_EQ(scene.config.spectral.lamps.empty(), light == "day");
    }
  }
}

}  // namespace
}  // namespace apvi::sim
