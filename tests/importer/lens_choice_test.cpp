// SPDX-License-Identifier: BSD-3-Clause
#include "importer/lens_choice.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>

#include "core/random.hpp"

namespace apvi::importer {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using testing::HasSubstr;

constexpr ImageSize kSize{960, 540};
constexpr double kDegree = M_PI / 180.0;

/// Distance from the principal point of a ray at an angle to the axis [px].
using Projection = std::function<double(double angle)>;

double snell(double angle) {
  return std::asin(1.333 * std::sin(angle));
}

Projection linear_behind_port(double focal) {
  return [=](double angle) { return focal * std::tan(snell(angle)); };
}
Projection wide_behind_port(double focal) {
  return [=](double angle) { return focal * snell(angle); };
}
Projection linear(double focal) {
  return [=](double angle) { return focal * std::tan(angle); };
}
Projection wide(double focal) {
  return [=](double angle) { return focal * angle; };
}

double focal_of_tangent(double degrees) {
  return 480.0 / std::tan(0.5 * degrees * kDegree);
}
double focal_of_angle(double degrees) {
  return 480.0 / (0.5 * degrees * kDegree);
}

/// A camera that swims and turns over a scene with relief. Positions are seen with noise.
class Scene {
 public:
  explicit Scene(int seed) : random_(seed) {}

  TrackSegment segment(const Projection& lens, double noise_px) {
    const Vector3d step = 0.08 * direction();
    const Vector3d turn = 0.015 * direction();
    TrackSegment segment;
    while (segment.tracks.size() < 80) {
      const double z = random_.uniform(1.5, 4.0);
      const Vector3d point(z * random_.uniform(-1.2, 1.2), z * random_.uniform(-0.7, 0.7), z);
      std::vector<Vector2d> track;
      for (int k = 0; k < 6; ++k) {
        const Eigen::AngleAxisd R(k * turn.norm(), turn.normalized());
        const auto pixel = seen(lens, R * (point - k * step), noise_px);
        if (pixel) track.push_back(*pixel);
      }
      if (track.size() == 6) segment.tracks.push_back(track);
    }
    return segment;
  }

 private:
  Vector3d direction() {
    return Vector3d(random_.normal(), random_.normal(), 0.5 * random_.normal()).normalized();
  }
  std::optional<Vector2d> seen(const Projection& lens, const Vector3d& p, double noise_px) {
    const double across = p.head<2>().norm();
    const double radius = lens(std::atan2(across, p.z()));
    const Vector2d noise(random_.normal(), random_.normal());
    const Vector2d pixel =
        Vector2d(479.5, 269.5) + radius / across * p.head<2>() + noise_px * noise;
    const bool inside = pixel.x() > 0 && pixel.x() < 959 && pixel.y() > 0 && pixel.y() < 539;
    return inside ? std::optional(pixel) : std::nullopt;
  }

  Random random_;
};

std::vector<TrackSegment> seen_through(const Projection& lens, int count = 8) {
  Scene scene(2718);
  std::vector<TrackSegment> segments;
  for (int s = 0; s < count; ++s) segments.push_back(scene.segment(lens, 0.2));
  return segments;
}

const FieldOfView kGoPro{
    .degrees = 118.0, .lens = Lens::equidistant, .in_air = true, .origin = "wide mode"};

// Largest difference of a camera to the truth over the width of the image [px].
double difference(const FieldOfView& view, bool under_water, const Projection& truth) {
  const CameraModel camera(assumed_camera(view, kSize, under_water));
  double worst = 0.0;
  for (double angle = 0.05; truth(angle) < 480.0; angle += 0.05) {
    const auto pixel = camera.project({std::sin(angle), 0.0, std::cos(angle)});
    worst = std::max(worst, std::abs(pixel->x() - 479.5 - truth(angle)));
  }
  return worst;
}

struct LensCase {
  std::string name;
  Projection truth;
  bool under_water;
};

void PrintTo(const LensCase& c, std::ostream* out) {
  *out << c.name;
}

class EveryLens : public testing::TestWithParam<LensCase> {};

TEST_P(EveryLens, IsFoundByTheTracks) {
  const LensCase& c = GetParam();
  const LensChoice found = choose_lens(kGoPro, kSize, c.under_water, seen_through(c.truth));
  EXPECT_GT(difference(kGoPro, c.under_water, c.truth), 25.0);
  EXPECT_LT(difference(found.view, c.under_water, c.truth), 5.0) << found.evidence;
  EXPECT_THAT(found.evidence, HasSubstr("t = "));
}

INSTANTIATE_TEST_SUITE_P(
    Lens, EveryLens,
    testing::Values(LensCase{"linear", linear_behind_port(focal_of_tangent(92.0)), true},
                    LensCase{"narrow", linear_behind_port(focal_of_tangent(73.0)), true},
                    LensCase{"wide", wide_behind_port(focal_of_angle(100.0)), true},
                    LensCase{"dome", wide(focal_of_angle(100.0)), true},
                    LensCase{"linear_in_air", linear(focal_of_tangent(87.0)), false}),
    [](const auto& tested) { return tested.param.name; });

TEST(ChooseLens, KeepsAnAssumedLensThatIsRight) {
  const Projection truth = wide_behind_port(focal_of_angle(118.0));
  const LensChoice found = choose_lens(kGoPro, kSize, true, seen_through(truth));
  EXPECT_EQ(found.view.origin, kGoPro.origin);
  EXPECT_THAT(found.evidence, HasSubstr("do not tell a better lens"));
}

TEST(ChooseLens, KeepsTheAssumedLensWithTooLittleEvidence) {
  const Projection truth = linear_behind_port(focal_of_tangent(92.0));
  const LensChoice found = choose_lens(kGoPro, kSize, true, seen_through(truth, 3));
  EXPECT_EQ(found.view.degrees, 118.0);
  EXPECT_THAT(found.evidence, HasSubstr("3 of 4"));
}

TEST(ChooseLens, KeepsTheAssumedLensOfACameraThatOnlyTurnsAboutItsAxis) {
  Random random(3141);
  std::vector<TrackSegment> segments(6);
  for (TrackSegment& segment : segments) {
    for (int i = 0; i < 80; ++i) {
      const Vector2d from(random.uniform(-260.0, 260.0), random.uniform(-260.0, 260.0));
      auto& track = segment.tracks.emplace_back();
      for (int k = 0; k < 6; ++k) {
        const Vector2d noise(random.normal(), random.normal());
        track.emplace_back(Vector2d(479.5, 269.5) + Eigen::Rotation2Dd(0.05 * k) * from +
                           0.2 * noise);
      }
    }
  }
  EXPECT_EQ(choose_lens(kGoPro, kSize, true, segments).view.origin, kGoPro.origin);
}

TEST(LensShape, RaysAndPixelsAreInverse) {
  for (const Lens lens : {Lens::rectilinear, Lens::equidistant}) {
    for (const bool port : {false, true}) {
      const LensShape shape{lens, port};
      const Vector2d pixel(-300.0, 210.0);
      const Vector3d ray = ray_of(shape, 466.0, pixel);
      EXPECT_LT((pixel_of(shape, 466.0, 2.5 * ray) - pixel).norm(), 1e-6);
      EXPECT_EQ(ray_of(shape, 466.0, Vector2d::Zero()), Vector3d::UnitZ());
    }
  }
}

}  // namespace
}  // namespace apvi::importer
