// SPDX-License-Identifier: BSD-3-Clause
#include "sim/render/water.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/core/error.hpp"
#include "sim/render/light.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3d;

constexpr JerlovType kTypes[] = {JerlovType::I,   JerlovType::IA, JerlovType::IB, JerlovType::II,
                                 JerlovType::III, JerlovType::C1, JerlovType::C3, JerlovType::C5,
                                 JerlovType::C7,  JerlovType::C9};

TEST(Medium, MatchesImageFormationModel) {
  Medium medium;
  medium.beta_d = Vector3d(0.5, 0.2, 0.1);
  medium.beta_b = Vector3d(0.4, 0.3, 0.2);
  medium.b_inf = Vector3d(0.1, 0.4, 0.5);
  const Vector3d seen = apply_medium(medium, Vector3d(0.8, 0.6, 0.4), 2.0);
  EXPECT_NEAR(seen.x(), 0.8 * std::exp(-1.0) + 0.1 * (1 - std::exp(-0.8)), 1e-15);
  EXPECT_NEAR(seen.y(), 0.6 * std::exp(-0.4) + 0.4 * (1 - std::exp(-0.6)), 1e-15);
  EXPECT_NEAR(seen.z(), 0.4 * std::exp(-0.2) + 0.5 * (1 - std::exp(-0.4)), 1e-15);
}

TEST(Medium, LimitsAreClearSceneAndVeilingLight) {
  const Medium medium = make_medium({});
  const Vector3d clear(0.3, 0.2, 0.1);
  EXPECT_TRUE(apply_medium(medium, clear, 0.0).isApprox(clear));
  EXPECT_TRUE(apply_medium(medium, clear, 1e4).isApprox(medium.b_inf));
}

TEST(Medium, HasRequestedAttenuationLengthForEveryWaterType) {
  for (const JerlovType type : kTypes) {
    for (const double length : {0.5, 3.0, 15.0}) {
      const Medium medium = make_medium({.type = type, .attenuation_length_m = length});
      EXPECT_NEAR(medium.beta_d.y(), 1.0 / length, 1e-12);
      EXPECT_TRUE((medium.beta_d.array() > 0.0).all() && (medium.beta_b.array() > 0.0).all());
    }
  }
}

TEST(Medium, EventOverridesAttenuationLengthAndKeepsDaylight) {
  const WaterConfig config{.type = JerlovType::II, .attenuation_length_m = 8.0};
  const Medium nominal = make_medium(config);
  const Medium turbid = make_medium(config, 0.5);
  EXPECT_NEAR(turbid.beta_d.y(), 2.0, 1e-12);
  EXPECT_EQ(turbid.k_d, nominal.k_d);
}

TEST(Medium, EventKeepsChannelRatiosOfExplicitCoefficients) {
  WaterConfig config;
  config.beta_d = {0.6, 0.2, 0.1};
  config.beta_b = {0.3, 0.1, 0.05};
  const Medium nominal = make_medium(config);
  EXPECT_EQ(nominal.beta_d, Vector3d(0.6, 0.2, 0.1));
  const Medium turbid = make_medium(config, 1.0);
  EXPECT_TRUE(turbid.beta_d.isApprox(Vector3d(3.0, 1.0, 0.5)));
  EXPECT_TRUE(turbid.beta_b.isApprox(Vector3d(1.5, 0.5, 0.25)));
}

TEST(Medium, OceanTransmitsBlueAndTurbidCoastGreen) {
  const Medium ocean = make_medium({.type = JerlovType::I, .attenuation_length_m = std::nullopt});
  EXPECT_LT(ocean.k_d.z(), ocean.k_d.y());
  EXPECT_LT(ocean.k_d.y(), ocean.k_d.x());
  const Medium coast = make_medium({.type = JerlovType::C9, .attenuation_length_m = std::nullopt});
  EXPECT_GT(coast.k_d.z(), coast.k_d.y());
  EXPECT_GT(coast.beta_d.y(), 20.0 * ocean.beta_d.y());
}

TEST(WaterConfig, RejectsUnknownJerlovType) {
  WaterConfig config;
  EXPECT_THROW(config::read(config::parse_yaml("type: IV", "water.yaml"), config), InputError);
  EXPECT_THROW(config::read(config::parse_yaml("attenuation_length_m: 0", "w.yaml"), config),
               InputError);
}

TEST(Daylight, AttenuatesExponentiallyWithDepth) {
  const Medium medium = make_medium({.type = JerlovType::III});
  const Vector3d ratio = daylight_at({}, medium, 12.0).cwiseQuotient(daylight_at({}, medium, 5.0));
  EXPECT_TRUE(ratio.isApprox(Vector3d((-7.0 * medium.k_d).array().exp())));
  EXPECT_TRUE(daylight_at({.daylight = 2.5}, medium, 0.0).isApprox(Vector3d::Constant(2.5)));
}

TEST(Lamp, FollowsInverseSquareLawAndAttenuation) {
  LampConfig lamp;
  lamp.position_m = {0.0, 0.0, 0.0};
  lamp.color = {1.0, 1.0, 1.0};
  const Medium medium = make_medium({});
  const Vector3d toward(0.0, 0.0, -1.0);
  const Vector3d at1 = lamp_irradiance(lamp, medium, Vector3d(0, 0, 1), toward);
  const Vector3d at3 = lamp_irradiance(lamp, medium, Vector3d(0, 0, 3), toward);
  EXPECT_TRUE(at1.isApprox(lamp.intensity * Vector3d((-medium.beta_d).array().exp())));
  const Vector3d expected = (-2.0 * medium.beta_d).array().exp() / 9.0;
  EXPECT_TRUE(at3.cwiseQuotient(at1).isApprox(expected));
}

TEST(Lamp, HasHalfIntensityAtBeamAngleAndNoneBehind) {
  const LampConfig lamp{.half_beam_deg = 40.0};
  EXPECT_DOUBLE_EQ(lamp_beam(lamp, 1.0), 1.0);
  EXPECT_NEAR(lamp_beam(lamp, std::cos(40.0 * M_PI / 180.0)), 0.5, 1e-12);
  EXPECT_EQ(lamp_beam(lamp, -0.1), 0.0);
}

}  // namespace
}  // namespace apvi::sim
