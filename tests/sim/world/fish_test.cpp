// SPDX-License-Identifier: BSD-3-Clause
#include "sim/world/fish.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <memory>
#include <numbers>
#include <opencv2/core.hpp>
#include <string>

#include "apvi/core/error.hpp"
#include "sim/render/renderer.hpp"
#include "sim/world/moving_scene.hpp"
#include "sim/world/world.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3d;

constexpr std::uint64_t kSeed = 5;

WorldConfig world_with(const SchoolConfig& school) {
  return {.kind = WorldKind::seabed,
          .depth_m = 4.0,
          .size_m = 10.0,
          .resolution_m = 0.2,
          .relief_m = 0.1,
          .rocks = 0.0,
          .marine_life = 0.0,
          .debris = 0.0,
          .fish = {school}};
}

WorldConfig small_world() {
  return world_with({.count = 30, .height_m = 0.7, .radius_m = 0.6, .length_m = 0.25});
}

RendererConfig bare_config(Physics physics) {
  RendererConfig config;
  config.physics = physics;
  config.water.snow.density_per_m3 = 0.0;
  config.camera.auto_gain = false;
  config.camera.white_balance = {1.0, 1.0, 1.0};
  config.camera.lens_blur_px = 0.0;
  config.camera.noise = false;
  config.camera.exposure_s = 0.0;
  return config;
}

CameraModel camera() {
  return CameraModel(
      {.fx = 100.0, .fy = 100.0, .cx = 79.5, .cy = 59.5, .width = 160, .height = 120});
}

struct Reef {
  explicit Reef(const RendererConfig& renderer_config)
      : config(renderer_config), renderer(mesh, caster, camera(), config, kSeed) {}

  ImageRequest request(double time_s, bool with_fish) const {
    ImageRequest request;
    const SE3 pose{Eigen::Quaterniond(Eigen::AngleAxisd(std::numbers::pi, Vector3d::UnitX())),
                   Vector3d(0.5, 0.0, -2.3)};
    request.T_world_camera = [pose](Stamp) { return pose; };
    request.development = Development{};
    if (with_fish) {
      request.moving = std::make_shared<MovingScene>(Fish(world, kSeed).at(time_s), caster,
                                                     sun_direction(config.light).cast<float>());
    }
    return request;
  }

  WorldConfig world = small_world();
  TriangleMesh mesh = make_world(world, kSeed);
  RayCaster caster{mesh};
  RendererConfig config;
  Renderer renderer;
};

bool same_bytes(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() &&
         std::memcmp(a.data, b.data, a.total() * a.elemSize()) == 0;
}

cv::Mat differing(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat channels[3];
  cv::Mat difference;
  cv::absdiff(a, b, difference);
  cv::split(difference, channels);
  return cv::max(cv::max(channels[0], channels[1]), channels[2]) > 0;
}

double fraction(const cv::Mat& mask) {
  return static_cast<double>(cv::countNonZero(mask)) / static_cast<double>(mask.total());
}

TEST(Fish, ArePartOfNoMesh) {
  WorldConfig without = small_world();
  without.fish.clear();
  EXPECT_EQ(make_world(small_world(), kSeed).vertices, make_world(without, kSeed).vertices);
}

TEST(Fish, DependOnTheSeedAndTheTimeOnly) {
  const Fish fish(small_world(), kSeed);
  const auto once = fish.at(12.5);
  fish.at(3.0);
  const auto again = Fish(small_world(), kSeed).at(12.5);
  const auto other = Fish(small_world(), kSeed + 1).at(12.5);
  ASSERT_EQ(once.size(), 30U);
  for (std::size_t i = 0; i < once.size(); ++i) {
    EXPECT_EQ(once[i].T_world_fish.matrix(), again[i].T_world_fish.matrix());
    EXPECT_NE(once[i].T_world_fish.matrix(), other[i].T_world_fish.matrix());
  }
}

TEST(Fish, SwimForwardWithTheirVelocity) {
  const Fish fish(small_world(), kSeed);
  constexpr double kStep = 1e-3;
  const auto now = fish.at(7.0);
  const auto later = fish.at(7.0 + kStep);
  for (std::size_t i = 0; i < now.size(); ++i) {
    const Vector3d moved =
        (later[i].T_world_fish.translation() - now[i].T_world_fish.translation()).cast<double>();
    EXPECT_LT((moved / kStep - now[i].velocity).norm(), 2e-3) << "numeric difference";
    EXPECT_LT(
        (now[i].T_world_fish.linear().col(0).cast<double>() - now[i].velocity.normalized()).norm(),
        1e-5);
  }
}

TEST(Fish, SwimAtTheMeanSpeedOfTheSchool) {
  const Fish fish(world_with({.count = 200, .radius_m = 5.0, .speed_m_s = 0.4}), kSeed);
  double sum = 0.0;
  for (const FishPose& pose : fish.at(4.0)) sum += pose.velocity.norm() / 200.0;
  EXPECT_NEAR(sum, 0.4, 0.04);
}

TEST(Fish, HaveTheLengthOfTheirPose) {
  TriangleMesh mesh;
  add_fish(mesh, {.T_world_fish = Eigen::Affine3f::Identity(), .length = 0.3F});
  EXPECT_NEAR(mesh.bounds().sizes().x(), 0.3F, 0.01F);
  EXPECT_EQ(mesh.vertices.size(), fish_vertex_count());
  EXPECT_EQ(mesh.texture.size(), mesh.vertices.size());
}

TEST(Fish, SchoolOutsideOfTheWorldIsRefused) {
  const WorldConfig world = world_with({.x_m = 6.0});
  EXPECT_THROW(
      {
        try {
          check_fish(world);
        } catch (const InputError& e) {
          EXPECT_THAT(e.what(), testing::HasSubstr("world.fish: a school at x 6 m"));
          throw;
        }
      },
      InputError);
}

class Rendered : public testing::TestWithParam<Physics> {};

TEST_P(Rendered, MaskIsWhereTheImageDiffersFromTheSameWithoutFish) {
  const Reef reef(bare_config(GetParam()));
  const RenderedFrame with = reef.renderer.render(reef.request(2.0, true));
  const RenderedFrame without = reef.renderer.render(reef.request(2.0, false));
  const cv::Mat body = with.moving == kMovingBody;
  const cv::Mat marked = with.moving > 0;
  ASSERT_GT(fraction(body), 0.02);
  EXPECT_LT(fraction(body), 0.6);
  const cv::Mat differs = differing(with.image, without.image);
  if (GetParam() == Physics::paper) {  // else light is also blurred beyond the mask
    EXPECT_EQ(cv::countNonZero(differs & ~marked), 0);
  }
  EXPECT_GT(cv::countNonZero(differs & body), 0.97 * cv::countNonZero(body))
      << "a fish may have the color of what is behind it in a few pixels";
  EXPECT_GT(cv::countNonZero(differs & marked & ~body), 0) << "shadows";
  EXPECT_TRUE(without.moving.empty());
}

TEST_P(Rendered, StaticTruthHasNoFish) {
  RendererConfig config = bare_config(GetParam());
  config.light.direct_fraction = 0.0;  // no shadows
  const Reef reef(config);
  const RenderedFrame with = reef.renderer.render(reef.request(2.0, true));
  const RenderedFrame without = reef.renderer.render(reef.request(2.0, false));
  EXPECT_FALSE(same_bytes(with.image, without.image));
  EXPECT_TRUE(same_bytes(with.depth, without.depth));
  EXPECT_TRUE(same_bytes(with.range, without.range));
  EXPECT_TRUE(same_bytes(with.clear, without.clear));
}

TEST_P(Rendered, SameFrameTwiceIsIdentical) {
  const Reef reef(bare_config(GetParam()));
  const RenderedFrame first = reef.renderer.render(reef.request(2.0, true), 1);
  const RenderedFrame second = reef.renderer.render(reef.request(2.0, true), 3);
  EXPECT_TRUE(same_bytes(first.image, second.image));
  EXPECT_TRUE(same_bytes(first.moving, second.moving));
  EXPECT_FALSE(same_bytes(first.moving, reef.renderer.render(reef.request(2.2, true)).moving));
}

std::string name_of(const testing::TestParamInfo<Physics>& info) {
  return info.param == Physics::paper ? "Paper" : "Spectral";
}

INSTANTIATE_TEST_SUITE_P(Fish, Rendered, testing::Values(Physics::paper, Physics::spectral),
                         name_of);

}  // namespace
}  // namespace apvi::sim
