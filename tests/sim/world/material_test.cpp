// SPDX-License-Identifier: BSD-3-Clause
#include "sim/world/material.hpp"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <string>
#include <tuple>

#include "core/random.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3f;

constexpr int kBatches = 400;
constexpr float kFine = 0.0005F;  // [m] footprint at which nothing is filtered out

struct Wall {
  Vector3f normal, light;
};
const Wall kBed{Vector3f(0.15F, 0.1F, 0.95F).normalized(), Vector3f(0.4F, 0.1F, 0.9F).normalized()};
const Wall kVertical{Vector3f(0.15F, -0.95F, 0.1F).normalized(),
                     Vector3f(0.4F, -0.8F, 0.45F).normalized()};

/// Mean color of a matte surface of 12 m by 12 m for pixels with a footprint [m].
Vector3f mean_color(Material material, const Wall& wall, float footprint) {
  const bool level = wall.normal.z() > 0.5F;
  Random random(7);
  const auto uniform = [&random] { return static_cast<float>(random.uniform()); };
  auto s = std::make_unique<SurfaceBatch>();
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (int n = 0; n < kBatches; ++n) {
    s->p.count = kBatch;
    for (int i = 0; i < kBatch; ++i) {
      const float a = 12.0F * uniform() - 6.0F;
      const float b = 12.0F * uniform() - 6.0F;
      s->p.x[i] = a;
      const float wave = 0.3F * std::sin(a) + 0.1F * b;  // crosses cells at every height
      s->p.y[i] = level ? b : wave;
      s->p.z[i] = level ? wave : b;
      s->p.footprint[i] = footprint;
      s->nx[i] = wall.normal.x();
      s->ny[i] = wall.normal.y();
      s->nz[i] = wall.normal.z();
      s->detail[i] = material == Material::sand ? 2.0F * uniform() : 0.8F;  // 2: stone
      s->object[i] = uniform();
    }
    evaluate_material(material, *s);
    for (int i = 0; i < kBatch; ++i) {
      const float light = std::max(0.0F, wall.light.dot(Vector3f(s->nx[i], s->ny[i], s->nz[i])));
      sum += Eigen::Vector3d(s->r[i], s->g[i], s->b[i]) * static_cast<double>(light);
    }
  }
  return (sum / (kBatches * kBatch)).cast<float>();
}

class EveryMaterial : public testing::TestWithParam<std::tuple<int, bool>> {};

// A color that depends on distance or resolution would bias the estimate of the medium.
TEST_P(EveryMaterial, BrightnessIsIndependentOfFootprint) {
  const auto material = static_cast<Material>(std::get<0>(GetParam()));
  const Wall& wall = std::get<1>(GetParam()) ? kVertical : kBed;
  const Vector3f near = mean_color(material, wall, kFine);
  for (const float footprint : {0.004F, 0.008F, 0.012F, 0.016F}) {
    const Vector3f far = mean_color(material, wall, footprint);
    for (int c = 0; c < 3; ++c) {
      EXPECT_NEAR(far[c] / near[c], 1.0F, 0.025F) << "channel " << c << ", pixels of " << footprint;
    }
  }
}

std::string name_of(const testing::TestParamInfo<std::tuple<int, bool>>& info) {
  constexpr std::array<const char*, kMaterialCount> kNames = {
      "Plain",    "Sand", "Silt",  "Rock", "BrainCoral", "BranchCoral", "PlateCoral", "Sponge",
      "FanCoral", "Weed", "Steel", "Wood", "Concrete",   "Mussels",     "Fish"};
  return std::string(kNames[static_cast<std::size_t>(std::get<0>(info.param))]) +
         (std::get<1>(info.param) ? "Upright" : "Level");
}

INSTANTIATE_TEST_SUITE_P(Materials, EveryMaterial,
                         testing::Combine(testing::Range(0, kMaterialCount), testing::Bool()),
                         name_of);

// Filtered-out bumps shorten the normal to the mean normal.
TEST(Material, FilteredNormalsAreTheMeanOfUnfilteredNormals) {
  auto s = std::make_unique<SurfaceBatch>();
  const auto mean_normal = [&s](float footprint) {
    Random random(3);
    Vector3f sum = Vector3f::Zero();
    for (int n = 0; n < kBatches; ++n) {
      s->p.count = kBatch;
      for (int i = 0; i < kBatch; ++i) {
        s->p.x[i] = 9.0F * static_cast<float>(random.uniform());
        s->p.y[i] = 9.0F * static_cast<float>(random.uniform());
        s->p.z[i] = 0.0F;
        s->p.footprint[i] = footprint;
        s->nx[i] = 0.0F;
        s->ny[i] = 0.6F;
        s->nz[i] = 0.8F;
        s->detail[i] = 1.0F;
        s->object[i] = 0.5F;
      }
      evaluate_material(Material::rock, *s);
      for (int i = 0; i < kBatch; ++i) sum += Vector3f(s->nx[i], s->ny[i], s->nz[i]);
    }
    return Vector3f(sum / static_cast<float>(kBatches * kBatch));
  };
  const Vector3f near = mean_normal(kFine);
  const Vector3f far = mean_normal(0.05F);
  EXPECT_LT(near.norm(), 0.95F);  // rough
  EXPECT_NEAR((far - near).norm(), 0.0F, 0.01F) << near.transpose() << ", " << far.transpose();
}

}  // namespace
}  // namespace apvi::sim
