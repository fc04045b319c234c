// SPDX-License-Identifier: BSD-3-Clause
#include "sim/render/renderer.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <vector>

#include "sim/world/world.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

CameraModel small_camera(int width = 160, int height = 120) {
  return CameraModel({.fx = 0.65 * width,
                      .fy = 0.65 * width,
                      .cx = 0.5 * width - 0.5,
                      .cy = 0.5 * height - 0.5,
                      .distortion = Distortion::radtan,
                      .coefficients = {-0.05, 0.01, 0.0, 0.0},
                      .width = width,
                      .height = height});
}

// Camera that looks straight down (or tilted by `tilt` about its x axis), its x to the east.
SE3 looking_down(const Vector3d& position, double tilt = 0.0) {
  const Eigen::AngleAxisd down(std::numbers::pi + tilt, Vector3d::UnitX());
  return {Eigen::Quaterniond(down), position};
}

// A level square of 40 m at height z.
TriangleMesh plane(float z, Material material = Material::plain) {
  TriangleMesh mesh;
  mesh.add_vertex({-20, -20, z});
  mesh.add_vertex({20, -20, z});
  mesh.add_vertex({20, 20, z});
  mesh.add_vertex({-20, 20, z});
  mesh.add_quad(0, 1, 2, 3, material);
  return mesh;
}

TriangleMesh sphere(const Vector3f& center, float radius) {
  constexpr int kSides = 720;
  constexpr int kRings = 360;
  TriangleMesh mesh;
  for (int j = 0; j <= kRings; ++j) {
    for (int i = 0; i < kSides; ++i) {
      const double polar = std::numbers::pi * j / kRings;
      const double around = 2.0 * std::numbers::pi * i / kSides;
      const Vector3d n(std::sin(polar) * std::cos(around), std::sin(polar) * std::sin(around),
                       std::cos(polar));
      mesh.add_vertex(center + radius * n.cast<float>());
    }
  }
  for (std::uint32_t j = 0; j < kRings; ++j) {
    for (std::uint32_t i = 0; i < kSides; ++i) {
      const std::uint32_t next = (i + 1) % kSides;
      mesh.add_quad(j * kSides + i, (j + 1) * kSides + i, (j + 1) * kSides + next,
                    j * kSides + next, Material::plain);
    }
  }
  return mesh;
}

// Light and water only, without camera effects.
RendererConfig bare_config() {
  RendererConfig config;
  config.water.snow.density_per_m3 = 0.0;
  config.camera.auto_gain = false;
  config.camera.gain = 1.5;
  config.camera.white_balance = {1.0, 1.0, 1.0};
  config.camera.vignetting = 0.0;
  config.camera.lens_blur_px = 0.0;
  config.camera.noise = false;
  config.camera.exposure_s = 0.0;
  return config;
}

ImageRequest still(const SE3& T_world_camera) {
  ImageRequest request;
  request.T_world_camera = [T_world_camera](Stamp) { return T_world_camera; };
  return request;
}

ImageRequest moving(const SE3& T_world_camera, const Vector3d& velocity, Stamp stamp = {}) {
  ImageRequest request;
  request.stamp = stamp;
  request.T_world_camera = [=](Stamp at) {
    return SE3{T_world_camera.rotation, T_world_camera.translation + at.seconds() * velocity};
  };
  return request;
}

struct RenderFixture {
  explicit RenderFixture(TriangleMesh m, const RendererConfig& config = bare_config(),
                         const CameraModel& lens = small_camera())
      : mesh(std::move(m)), caster(mesh), camera(lens), renderer(mesh, caster, lens, config, 7) {}
  TriangleMesh mesh;
  RayCaster caster;
  CameraModel camera;
  Renderer renderer;
};

bool same_bytes(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() &&
         std::memcmp(a.data, b.data, a.total() * a.elemSize()) == 0;
}

TEST(RayCaster, HitsAPlaneFromBothSides) {
  const TriangleMesh mesh = plane(-10.0F);
  const RayCaster caster(mesh);
  const Vector3d slanted = Vector3d(0.6, 0.0, -0.8);
  const auto above = caster.cast({1, 2, -7}, slanted, 50.0);
  ASSERT_TRUE(above);
  EXPECT_NEAR(above->range, 3.0 / 0.8, 1e-5);
  EXPECT_TRUE(above->normal.isApprox(Vector3d::UnitZ(), 1e-6));
  const auto below = caster.cast({1, 2, -12}, Vector3d::UnitZ(), 50.0);
  ASSERT_TRUE(below);
  EXPECT_NEAR(below->range, 2.0, 1e-5);
  EXPECT_TRUE(below->normal.isApprox(-Vector3d::UnitZ(), 1e-6));
}

TEST(RayCaster, MissesBeyondMaxRangeAndOutsideTheMesh) {
  const RayCaster caster(plane(-10.0F));
  EXPECT_FALSE(caster.cast({0, 0, -7}, -Vector3d::UnitZ(), 2.9));
  EXPECT_FALSE(caster.cast({0, 0, -7}, Vector3d::UnitZ(), 100.0));
  EXPECT_TRUE(caster.occluded({0, 0, -7}, -Vector3f::UnitZ(), 3.1F));
  EXPECT_FALSE(caster.occluded({0, 0, -7}, -Vector3f::UnitZ(), 2.9F));
}

TEST(RayCaster, BatchMatchesSingleRays) {
  const TriangleMesh mesh = make_world({.depth_m = 9, .size_m = 10, .resolution_m = 0.2}, 3);
  const RayCaster caster(mesh);
  RayBatch rays;
  rays.resize(101);  // not a multiple of a packet
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const Vector3f d = Vector3f(-0.5F + 0.01F * static_cast<float>(i), 0.2F, -0.7F).normalized();
    rays.ox[i] = 0.1F;
    rays.oy[i] = -0.2F;
    rays.oz[i] = -6.0F;
    rays.dx[i] = d.x();
    rays.dy[i] = d.y();
    rays.dz[i] = i == 50 ? 1.0F : d.z();  // one that misses
    rays.range[i] = 60.0F;
  }
  caster.cast(rays);
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const auto hit = caster.cast({0.1F, -0.2F, -6.0F},
                                 Vector3f(rays.dx[i], rays.dy[i], rays.dz[i]).cast<double>(), 60.0);
    ASSERT_EQ(hit.has_value(), rays.range[i] != RayBatch::kNoHit) << i;
    EXPECT_NEAR(rays.range[i], hit ? hit->range : -1.0, 1e-4) << i;
  }
}

TEST(Renderer, DepthOfAPlaneIsAnalytic) {
  const RenderFixture fixture(plane(-10.0F));
  const SE3 T_world_camera = looking_down({0.3, -0.2, -7.0}, 0.5);
  const RenderedFrame frame = fixture.renderer.render(still(T_world_camera));
  for (int y = 0; y < 120; y += 7) {
    for (int x = 0; x < 160; x += 7) {
      const Vector3d ray = *fixture.camera.unproject({x, y});
      const double range = -3.0 / (T_world_camera.rotation * ray).z();
      EXPECT_NEAR(frame.range.at<float>(y, x), range, 2e-4 * range);
      EXPECT_NEAR(frame.depth.at<float>(y, x), range * ray.z(), 2e-4 * range);
    }
  }
}

TEST(Renderer, DepthOfASphereIsAnalyticAndZeroOutside) {
  const RenderFixture fixture(sphere({0.0F, 0.0F, -10.0F}, 1.0F));
  const RenderedFrame frame = fixture.renderer.render(still(looking_down({0.0, 0.0, -7.0})));
  int hits = 0;
  for (int y = 0; y < 120; ++y) {
    for (int x = 0; x < 160; ++x) {
      const Vector3d ray = *fixture.camera.unproject({x, y});
      const double along = 3.0 * ray.z();
      const double square = 1.0 - (9.0 - along * along);  // radius² - distance of the ray²
      if (std::abs(square) < 0.02) continue;              // the outline of the tessellation
      const double range = square > 0.0 ? along - std::sqrt(square) : 0.0;
      ASSERT_NEAR(frame.depth.at<float>(y, x), range * ray.z(), 5e-4) << x << ", " << y;
      hits += square > 0.0 ? 1 : 0;
    }
  }
  EXPECT_GT(hits, 500);
}

// Largest difference in gray levels between an image and the image formation model applied to its
// clear version, over pixels that are not saturated.
double formula_error(const RenderedFrame& frame) {
  double worst = 0.0;
  for (int y = 0; y < frame.image.rows; ++y) {
    for (int x = 0; x < frame.image.cols; ++x) {
      const auto clear = frame.clear.at<cv::Vec3b>(y, x);
      const auto seen = frame.image.at<cv::Vec3b>(y, x);
      const float range = frame.range.at<float>(y, x);
      const Vector3d J = Vector3d(clear[2], clear[1], clear[0]) / 255.0;
      const Vector3d I = 255.0 * apply_medium(frame.medium, J, range > 0.0F ? range : 1e6);
      for (int c = 0; c < 3; ++c) {
        if (clear[2 - c] == 255 || seen[2 - c] == 255) continue;
        worst = std::max(worst, std::abs(I[c] - seen[2 - c]));
      }
    }
  }
  return worst;
}

TEST(Renderer, ImageMatchesImageFormationModelToOneGrayLevel) {
  RendererConfig config = bare_config();
  config.light.lamp = LampConfig{.intensity = 0.4, .backscatter = 0.0};
  config.light.caustics = 0.5;
  config.camera.auto_gain = true;
  const RenderFixture fixture(make_world({.depth_m = 9, .size_m = 12, .resolution_m = 0.1}, 3),
                              config);
  ImageRequest request = still(looking_down({0.0, 0.0, -6.5}, 0.9));
  EXPECT_LE(formula_error(fixture.renderer.render(request)), 1.0);
  request.disturbance.attenuation_length_m = 1.2;
  EXPECT_LE(formula_error(fixture.renderer.render(request)), 1.0);
}

Vector3d center_of_clear(const RenderedFrame& frame) {
  const auto pixel = frame.clear.at<cv::Vec3b>(frame.clear.rows / 2, frame.clear.cols / 2);
  return Vector3d(pixel[2], pixel[1], pixel[0]) / 255.0;
}

TEST(Renderer, DaylightAttenuatesWithDepth) {
  for (const double depth : {2.0, 6.0, 12.0}) {
    const RendererConfig config = bare_config();
    const RenderFixture fixture(plane(static_cast<float>(-depth)), config);
    const auto frame = fixture.renderer.render(still(looking_down({0.0, 0.0, 1.5 - depth})));
    const Medium medium = make_medium(config.water);
    const Vector3d expected =
        config.camera.gain * 0.5 * daylight_at(config.light, medium, depth);  // albedo 0.5
    EXPECT_LT((center_of_clear(frame) - expected).cwiseAbs().maxCoeff(), 0.6 / 255.0) << depth;
  }
}

// Backscatter of a lamp per unit of `backscatter`: integral along the ray by the trapezoidal rule
// with steps of 1 mm.
Vector3d backscatter_integral(const LampConfig& lamp, const Medium& medium, const Vector3d& ray,
                              double range) {
  const Vector3d position(lamp.position_m[0], lamp.position_m[1], lamp.position_m[2]);
  const Vector3d color(lamp.color[0], lamp.color[1], lamp.color[2]);
  const auto at = [&](double t) -> Vector3d {
    const Vector3d from = t * ray - position;
    const double d = from.norm();
    const Vector3d water = (-medium.beta_d * (d + t)).array().exp();
    return lamp.intensity * lamp_beam(lamp, from.z() / d) / (d * d) * color.cwiseProduct(water);
  };
  const int steps = static_cast<int>(std::ceil(range / 1e-3));
  Vector3d sum = 0.5 * (at(0.0) + at(range));
  for (int k = 1; k < steps; ++k) sum += at(k * range / steps);
  return 0.035 * medium.beta_d.y() * range / steps * sum;
}

TEST(Renderer, LampBackscatterMatchesTheIntegral) {
  RendererConfig config = bare_config();
  config.light.daylight = 0.0;
  config.water.veiling_light = 0.0;
  config.light.lamp = LampConfig{.intensity = 0.25, .backscatter = 5.0};
  for (const double distance : {0.5, 1.5, 4.0}) {
    const RenderFixture fixture(plane(-9.0F), config);
    const auto frame = fixture.renderer.render(still(looking_down({0.0, 0.0, -9.0 + distance})));
    const Medium medium = make_medium(config.water);
    for (const cv::Point pixel : {cv::Point{12, 8}, {80, 60}, {150, 30}, {20, 110}}) {
      const Vector3d ray = fixture.camera.unproject({pixel.x, pixel.y})->normalized();
      const double range = frame.range.at<float>(pixel);
      const auto clear = frame.clear.at<cv::Vec3b>(pixel);
      const auto seen = frame.image.at<cv::Vec3b>(pixel);
      const Vector3d lamp_backscatter =
          config.light.lamp->backscatter * config.camera.gain *
          backscatter_integral(*config.light.lamp, medium, ray, range);
      const Vector3d through = (-medium.beta_d * range)
                                   .array()
                                   .exp()
                                   .matrix()
                                   .cwiseProduct(Vector3d(clear[2], clear[1], clear[0]) / 255.0);
      const Vector3d expected = through + lamp_backscatter;
      const Vector3d shown = Vector3d(seen[2], seen[1], seen[0]) / 255.0;
      EXPECT_LT((shown - expected).cwiseAbs().maxCoeff(),
                0.02 * lamp_backscatter.maxCoeff() + 1.1 / 255.0)
          << distance << " m, " << pixel;
    }
  }
}

TEST(Renderer, LampIrradianceMatchesTheModel) {
  for (const double distance : {0.8, 1.5, 3.0}) {
    RendererConfig config = bare_config();
    config.light.daylight = 0.0;
    config.light.lamp = LampConfig{.intensity = 0.6, .position_m = {0.2, -0.1, 0.0}};
    const RenderFixture fixture(plane(-9.0F), config);
    const auto frame = fixture.renderer.render(still(looking_down({0.0, 0.0, -9.0 + distance})));
    const Vector3d ray = *fixture.camera.unproject({80, 60});
    const Vector3d p = ray * (distance / ray.z());
    const Vector3d expected =
        config.camera.gain * 0.5 *
        lamp_irradiance(*config.light.lamp, make_medium(config.water), p, -Vector3d::UnitZ());
    EXPECT_LT((center_of_clear(frame) - expected).cwiseAbs().maxCoeff(), 0.6 / 255.0) << distance;
  }
}

RendererConfig all_effects_config() {
  RendererConfig config;
  config.light.lamp = LampConfig{};
  config.light.caustics = 0.5;
  config.water.veiling_light_gradient = 0.3;
  config.camera.shutter = Shutter::rolling;
  config.camera.blur_samples = 5;
  config.camera.gamma = 2.0;
  return config;
}

TEST(Renderer, OutputIsIndependentOfThreadCountAndOrder) {
  const RenderFixture fixture(make_world({.depth_m = 9, .size_m = 12, .resolution_m = 0.15}, 3),
                              all_effects_config());
  std::vector<ImageRequest> requests;
  for (int i = 0; i < 3; ++i) {
    const Stamp stamp{50000000LL * i};
    requests.push_back(moving(looking_down({0, 0, -7}, 0.6), {0.8, 0.1, 0.0}, stamp));
    requests.back().frame = static_cast<std::uint64_t>(i);
    requests.back().disturbance.silt = 0.2 * i;
  }
  std::vector<RenderedFrame> first;
  for (const ImageRequest& request : requests) first.push_back(fixture.renderer.render(request, 1));
  for (const int threads : {4, 2}) {
    for (std::size_t i = requests.size(); i-- > 0;) {
      const RenderedFrame again = fixture.renderer.render(requests[i], threads);
      EXPECT_TRUE(same_bytes(again.image, first[i].image)) << threads << " threads, frame " << i;
      EXPECT_TRUE(same_bytes(again.clear, first[i].clear));
      EXPECT_TRUE(same_bytes(again.depth, first[i].depth));
    }
  }
  EXPECT_FALSE(same_bytes(first[0].image, first[1].image));
}

TEST(Renderer, NoiseHasShotAndReadNoiseVariance) {
  RendererConfig config = bare_config();
  config.camera.noise = true;
  config.camera.full_well_e = 4000.0;
  config.camera.read_noise_e = 20.0;
  const RenderFixture fixture(plane(-6.0F), config, small_camera(320, 240));
  config.camera.noise = false;
  const RenderFixture clean(plane(-6.0F), config, small_camera(320, 240));
  const ImageRequest request = still(looking_down({0.0, 0.0, -5.0}));
  cv::Mat difference;
  const RenderedFrame noiseless = clean.renderer.render(request);
  cv::subtract(fixture.renderer.render(request).image, noiseless.image, difference, cv::noArray(),
               CV_32F);
  cv::Scalar mean;
  cv::Scalar sigma;
  cv::meanStdDev(difference, mean, sigma);
  const double electrons = config.camera.full_well_e / config.camera.gain;
  const cv::Scalar level = cv::mean(noiseless.image) / 255.0;
  for (int c = 0; c < 3; ++c) {
    const double expected = 255.0 * std::sqrt(level[c] * electrons + 400.0) / electrons;
    EXPECT_NEAR(sigma[c], expected, 0.05 * expected + 0.05);
    EXPECT_NEAR(mean[c], 0.0, 0.1);
  }
}

TEST(Renderer, NoiseDiffersBetweenFrames) {
  RendererConfig config = bare_config();
  config.camera.noise = true;
  const RenderFixture fixture(plane(-6.0F), config);
  ImageRequest request = still(looking_down({0.0, 0.0, -5.0}));
  const cv::Mat first = fixture.renderer.render(request).image;
  for (const std::uint64_t frame : {std::uint64_t{1}, std::uint64_t{1} << 40}) {
    request.frame = frame;
    EXPECT_FALSE(same_bytes(fixture.renderer.render(request).image, first));
  }
}

TEST(Renderer, ImageIsBlackInBlackoutAndSaturatedWhenOverexposed) {
  RendererConfig config;
  config.light.lamp = LampConfig{};
  const RenderFixture fixture(make_world({.depth_m = 9, .size_m = 12, .resolution_m = 0.15}, 3),
                              config);
  ImageRequest request = still(looking_down({0.0, 0.0, -7.0}));
  request.disturbance.darkness = 1.0;
  const cv::Scalar dark = cv::mean(fixture.renderer.render(request).image);
  EXPECT_LT(dark[0] + dark[1] + dark[2], 10.0);
  request.disturbance = {.exposure = 8.0};
  EXPECT_GT(cv::mean(fixture.renderer.render(request).image)[1], 240.0);
}

TEST(Renderer, RollingShutterSkewsMovingEdges) {
  TriangleMesh mesh;  // the edge of a plate runs along the image's y axis
  mesh.add_vertex({0, -20, -9});
  mesh.add_vertex({20, -20, -9});
  mesh.add_vertex({20, 20, -9});
  mesh.add_vertex({0, 20, -9});
  mesh.add_quad(0, 1, 2, 3, Material::plain);
  const auto edge_shift = [&](Shutter shutter) {
    RendererConfig config = bare_config();
    config.camera.shutter = shutter;
    config.camera.readout_s = 0.05;
    const CameraModel lens({.fx = 200,
                            .fy = 200,
                            .cx = 79.5,
                            .cy = 59.5,
                            .distortion = Distortion::none,
                            .coefficients = {},
                            .width = 160,
                            .height = 120});
    const RenderFixture fixture(mesh, config, lens);
    const cv::Mat depth =
        fixture.renderer.render(moving(looking_down({0, 0, -7}), {1.0, 0, 0})).depth;
    return cv::countNonZero(depth.row(119)) - cv::countNonZero(depth.row(0));
  };
  EXPECT_EQ(edge_shift(Shutter::global), 0);
  // 1 m/s * 0.05 s at 2 m and 200 px of focal length: 5 px. Later rows show more of the plate.
  EXPECT_NEAR(edge_shift(Shutter::rolling), 5, 1);
}

TEST(Renderer, MotionDuringExposureBlursTheImage) {
  RendererConfig config = bare_config();
  config.camera.exposure_s = 0.03;
  config.camera.blur_samples = 9;
  const RenderFixture fixture(make_world({.depth_m = 9, .size_m = 12, .resolution_m = 0.1}, 3),
                              config, small_camera(320, 240));
  const auto sharpness = [&](const Vector3d& velocity) {
    cv::Mat edges;
    cv::Laplacian(fixture.renderer.render(moving(looking_down({0, 0, -7.5}), velocity)).image,
                  edges, CV_32F);
    cv::Scalar mean;
    cv::Scalar sigma;
    cv::meanStdDev(edges, mean, sigma);
    return sigma[1];
  };
  EXPECT_LT(sharpness({1.0, 0.0, 0.0}), 0.6 * sharpness({0.0, 0.0, 0.0}));
}

// Number of corners of the first image that optical flow tracks to within one pixel of their true
// position in the second one. (On pure noise, optical flow reports spurious tracks.)
int tracked(const RenderedFrame& first, const cv::Mat& second, const CameraModel& camera,
            const SE3& T_second_first) {
  cv::Mat a;
  cv::Mat b;
  cv::cvtColor(first.image, a, cv::COLOR_BGR2GRAY);
  cv::cvtColor(second, b, cv::COLOR_BGR2GRAY);
  std::vector<cv::Point2f> corners;
  cv::goodFeaturesToTrack(a, corners, 300, 0.01, 15.0);
  if (corners.empty()) return 0;
  std::vector<cv::Point2f> moved;
  std::vector<uchar> found;
  cv::calcOpticalFlowPyrLK(a, b, corners, moved, found, cv::noArray());
  int count = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Vector3d ray = *camera.unproject({corners[i].x, corners[i].y});
    const double range =
        first.range.at<float>(cv::Point(cvRound(corners[i].x), cvRound(corners[i].y)));
    const auto expected = camera.project(T_second_first * Vector3d(range * ray));
    const Eigen::Vector2d seen(moved[i].x, moved[i].y);
    if (found[i] && expected && (*expected - seen).norm() < 1.0) ++count;
  }
  return count;
}

TEST(Renderer, OpticalFlowTracksCornersExceptInOutages) {
  const RenderFixture fixture(make_world({.depth_m = 9, .size_m = 14, .resolution_m = 0.08}, 3),
                              RendererConfig{}, small_camera(640, 480));
  const auto follow = [&](double speed, const Disturbance& disturbance) {
    ImageRequest request = moving(looking_down({0, 0, -7.2}, 0.4), {speed, 0, 0});
    request.disturbance = disturbance;
    const RenderedFrame first = fixture.renderer.render(request);
    const SE3 T_world_first = request.T_world_camera(request.stamp);
    request.stamp = {50000000};
    request.frame = 1;
    const SE3 T_second_first = request.T_world_camera(request.stamp).inverse() * T_world_first;
    return tracked(first, fixture.renderer.render(request).image, fixture.camera, T_second_first);
  };
  for (const double speed : {0.2, 0.5, 0.8}) EXPECT_GE(follow(speed, {}), 150) << speed;
  EXPECT_LE(follow(0.5, {.darkness = 1.0}), 20);
  EXPECT_LE(follow(0.5, {.attenuation_length_m = 0.25}), 20);
  EXPECT_LE(follow(0.5, {.silt = 0.97}), 20);
}

}  // namespace
}  // namespace apvi::sim
