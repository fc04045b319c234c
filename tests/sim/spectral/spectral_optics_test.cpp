// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>

#include "sim/spectral/camera_pipeline.hpp"
#include "sim/spectral/effective_medium.hpp"
#include "sim/spectral/exposure_track.hpp"
#include "sim/spectral/forward_blur.hpp"
#include "sim/spectral/lamp_light.hpp"
#include "sim/spectral/light_field.hpp"
#include "sim/spectral/phase_function.hpp"
#include "sim/spectral/sensor.hpp"
#include "sim/spectral/tone_curve.hpp"
#include "sim/spectral/water_optics.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3d;

constexpr double kPi = std::numbers::pi;

// Fraction scattered between two angles, by the midpoint rule in logarithmic steps.
double scattered(const FournierForand& phase, double low, double high) {
  constexpr int kSteps = 20001;  // odd, so that no midpoint is where the formula is 0 / 0
  double sum = 0.0;
  for (int i = 0; i < kSteps; ++i) {
    const double a = low * std::pow(high / low, static_cast<double>(i) / kSteps);
    const double b = low * std::pow(high / low, static_cast<double>(i + 1) / kSteps);
    const double angle = 0.5 * (a + b);
    sum += 2.0 * kPi * std::sin(angle) * phase.value(std::cos(angle)) * (b - a);
  }
  return sum;
}

TEST(PhaseFunction, ConservesEnergy) {
  const FournierForand phase;
  EXPECT_NEAR(phase.cumulative(1e-3) + scattered(phase, 1e-3, kPi), 1.0, 1e-4);
  EXPECT_NEAR(phase.cumulative(kPi), 1.0, 1e-12);
  EXPECT_NEAR(scattered(phase, 1e-3, kSmallAngle), small_angle_fraction() - phase.cumulative(1e-3),
              1e-4);
}

TEST(PhaseFunction, ScattersBackwardAsPetzoldMeasured) {
  const FournierForand phase;
  EXPECT_NEAR(phase.backscatter_fraction(), 0.0183, 2e-4);
  EXPECT_NEAR(scattered(phase, 0.5 * kPi, kPi), 0.0183, 2e-4);
}

TEST(PhaseFunction, ClassesOfSmallAnglesAddUpAndWiden) {
  double sum = sharp_fraction();
  double before = 0.0;
  for (const AngleClass& angles : small_angle_classes()) {
    sum += angles.fraction;
    EXPECT_GT(angles.rms, before);
    before = angles.rms;
  }
  EXPECT_NEAR(sum, small_angle_fraction(), 1e-12);
  EXPECT_LT(before, kSmallAngle / std::sqrt(2.0));
}

constexpr JerlovType kTypes[] = {JerlovType::I,   JerlovType::IA, JerlovType::IB, JerlovType::II,
                                 JerlovType::III, JerlovType::C1, JerlovType::C3, JerlovType::C5,
                                 JerlovType::C7,  JerlovType::C9};

// Jerlov's K_d at 475 nm (Marine Optics, 1976, table XXVII); here at 480 nm from absorption and
// scattering that others measured.
TEST(WaterOptics, DiffuseAttenuationIsThatOfJerlov) {
  constexpr double kJerlov[] = {0.018, 0.025, 0.033, 0.062, 0.116,
                                0.170, 0.290, 0.430, 0.710, 1.23};
  double before = 0.0;
  for (int i = 0; i < 10; ++i) {
    const double k_d = make_optics(kTypes[i], std::nullopt).diffuse(30.0)[4];
    EXPECT_NEAR(k_d / kJerlov[i], 1.0, 0.5) << i;
    EXPECT_GT(k_d, before) << i;
    before = k_d;
  }
}

TEST(WaterOptics, AttenuationsAreOrdered) {
  for (const JerlovType type : kTypes) {
    const WaterOptics water = make_optics(type, std::nullopt);
    for (std::size_t k = 0; k < kBands; ++k) {
      EXPECT_GT(water.beam()[k], water.sharp()[k]);
      EXPECT_GT(water.sharp()[k], water.smooth()[k]);
      EXPECT_GT(water.smooth()[k], water.absorption[k]);
      EXPECT_GT(water.diffuse(20.0)[k], water.absorption[k]);
    }
  }
}

TEST(WaterOptics, HasRequestedAttenuationLength) {
  for (const double length : {0.5, 2.0, 6.0})
    EXPECT_NEAR(beam_at_green(make_optics(JerlovType::C3, length)), 1.0 / length, 1e-12);
  EXPECT_EQ(make_optics(JerlovType::C3, 100.0).absorption, pure_water().absorption);
}

TEST(Sensor, GrayStaysGray) {
  const Spectrum daylight = daylight_spectrum();
  const auto basis = reflectance_basis();
  for (const SensorType type : {SensorType::nikon_d5100, SensorType::galaxy_s20}) {
    const Sensor sensor = make_sensor(type);
    const Spectrum gray = make_spectrum([&](int k) {
      const auto i = static_cast<std::size_t>(k);
      return 0.4 * (basis[0][i] + basis[1][i] + basis[2][i]) * daylight[i];
    });
    EXPECT_TRUE(sensor.raw(gray).isApprox(Vector3d::Constant(0.4), 1e-12));
    const Vector3d corrected = color_matrix(sensor) * sensor.raw(gray);
    EXPECT_TRUE(corrected.isApprox(Vector3d::Constant(0.4), 1e-9));
  }
}

TEST(Sensor, BasisReflectancesArePossible) {
  for (const Spectrum& reflectance : reflectance_basis()) {
    for (const double value : reflectance) {
      EXPECT_GE(value, 0.0);
      EXPECT_LE(value, 1.0);
    }
  }
}

TEST(LightField, IsScaledToOneDownwellingIrradiance) {
  EXPECT_NEAR(diffuse_irradiance().at(1.0F), 1.0F, 1e-5F);
  // The integral of m / (1 - e m)^2 over m from 0 to 1 is (ln(1 - e) + 1 / (1 - e) - 1) / e^2.
  const double whole = (std::log(0.1) + 10.0 - 1.0) / 0.81;
  EXPECT_NEAR(diffuse_radiance(0.0), 1.0 / (2.0 * kPi * whole), 2e-3 * diffuse_radiance(0.0));
  for (float up = 1.0F; up > -0.9F; up -= 0.1F)
    EXPECT_GT(diffuse_irradiance().at(up), diffuse_irradiance().at(up - 0.1F));
}

TEST(LampLobe, HasHalfIntensityAtItsAngleAndNoneBehind) {
  SpectralLampConfig lamp;
  lamp.half_beam_deg = 40.0;
  lamp.spill = 0.0;
  const LampLobe lobe(lamp);
  EXPECT_FLOAT_EQ(lobe.at(1.0F), 1.0F);
  EXPECT_NEAR(lobe.at(std::cos(40.0F * static_cast<float>(kPi) / 180.0F)), 0.5F, 5e-3F);
  EXPECT_GT(lobe.at(std::cos(20.0F * static_cast<float>(kPi) / 180.0F)), 0.93F);
  EXPECT_EQ(lobe.at(-0.2F), 0.0F);
}

TEST(ToneCurve, RisesFromBlackToWhite) {
  for (const ToneCurve curve :
       {ToneCurve::linear, ToneCurve::srgb, ToneCurve::gamma, ToneCurve::film}) {
    EXPECT_NEAR(tone(curve, 2.2, 0.0), 0.0, 1e-12);
    EXPECT_NEAR(tone(curve, 2.2, 1.0), 1.0, 1e-12);
    for (double x = 0.0; x < 0.999; x += 0.01)
      EXPECT_LT(tone(curve, 2.2, x), tone(curve, 2.2, x + 0.01));
  }
  EXPECT_NEAR(tone(ToneCurve::srgb, 1.0, 0.18), 0.4614, 1e-4);
  EXPECT_EQ(ToneTable(ToneCurve::srgb, 1.0)(0.18F), 118);
}

TEST(Exposure, FollowsWithItsLag) {
  std::vector<Metering> meterings;
  for (int i = 0; i <= 100; ++i)  // the light drops to a fourth after 2 s
    meterings.push_back({0.1 * i, {.behind_lens = Vector3d::Constant(i < 20 ? 0.4 : 0.1)}});
  CameraEffectsConfig effects;
  effects.target_mean = 0.2;
  effects.max_gain = 100.0;
  const SpectralConfig spectral{.exposure_lag_s = 1.0};
  const ExposureTrack track(meterings, effects, spectral, Vector3d::Ones());
  EXPECT_NEAR(track.at(1.0).gain, 0.5, 1e-12);
  EXPECT_NEAR(track.at(2.9).gain, 0.5 * std::pow(4.0, 1.0 - std::exp(-1.0)), 0.02);
  EXPECT_NEAR(track.at(10.0).gain, 2.0, 0.01);
}

TEST(Exposure, OfClearImagesIsOneForTheRecording) {
  std::vector<Metering> meterings;
  for (int i = 0; i <= 10; ++i)
    meterings.push_back(
        {0.1 * i,
         {.behind_lens = Vector3d(0.1, 0.2, 0.1), .clear = Vector3d::Constant(0.1 * (i + 1))}});
  CameraEffectsConfig effects;
  effects.target_mean = 0.3;
  const ExposureTrack track(meterings, effects, {}, Vector3d(1.0, 1.0, 3.0));
  const SpectralConfig fixed{.white_balance = WhiteBalance::preset};
  const ExposureTrack preset(meterings, effects, fixed, Vector3d(1.0, 1.0, 3.0));
  EXPECT_EQ(preset.clear().white_balance, Vector3d(1.0, 1.0, 3.0));
  EXPECT_NEAR(preset.clear().gain, 0.3 / (0.6 * 1.5), 1e-12);  // median 0.6, level 0.25, 0.5, 0.75
  EXPECT_EQ(track.clear().white_balance, track.at(0.5).white_balance);
}

TEST(Exposure, IsMeteredBehindTheLens) {
  const Sensor sensor = make_sensor(SensorType::nikon_d5100);
  Lens lens{.width = 40, .height = 30, .rays = {}, .origins = {}, .angle = {}};
  for (int i = 0; i < 40 * 30; ++i) {
    lens.rays.push_back(Eigen::Vector3f((static_cast<float>(i % 40) - 19.5F) / 20.0F,
                                        (static_cast<float>(i / 40) - 14.5F) / 20.0F, 1.0F)
                            .normalized());
    lens.angle.push_back(0.05F);
  }
  const CameraPipeline pipeline({}, {.lens_shading = 0.0}, sensor, lens);
  double cos4 = 0.0;
  for (const auto& ray : lens.rays) cos4 += std::pow(static_cast<double>(ray.z()), 4.0) / 1200.0;
  const cv::Mat even(30, 40, CV_32FC3, cv::Scalar::all(0.5));
  EXPECT_NEAR(pipeline.mean_behind_lens(even)[1], 0.5 * cos4, 1e-6);
  const cv::Mat small(15, 20, CV_32FC3, cv::Scalar::all(0.5));
  EXPECT_NEAR(pipeline.mean_behind_lens(small)[1], 0.5 * cos4, 1e-3);
}

TEST(Exposure, AutomaticWhiteBalanceGoesTowardGray) {
  const Vector3d raw(0.1, 0.4, 0.3);
  const Development goal = aim(raw, {}, WhiteBalance::automatic, Vector3d::Ones());
  const Vector3d balanced = raw.cwiseProduct(goal.white_balance);
  EXPECT_NEAR(balanced.x() / balanced.y(), std::pow(0.25, 0.15), 1e-9);
  EXPECT_NEAR(balanced.z() / balanced.y(), std::pow(0.75, 0.15), 1e-9);
  const Development fixed = aim(raw, {}, WhiteBalance::preset, Vector3d(2.0, 1.0, 1.5));
  EXPECT_EQ(fixed.white_balance, Vector3d(2.0, 1.0, 1.5));
}

TEST(EffectiveMedium, RecoversCoefficientsThatExist) {
  const Vector3d beta_d(0.5, 0.2, 0.15);
  const Vector3d beta_b(0.4, 0.25, 0.2);
  const Vector3d b_inf(0.05, 0.2, 0.3);
  std::vector<SeenSurface> surfaces;
  std::vector<SeenBackscatter> scattered_all;
  for (int i = 1; i <= 30; ++i) {
    const double r = 0.4 * i;
    const Vector3d clear(0.1 + 0.02 * i, 0.4, 0.7 - 0.02 * i);
    surfaces.push_back({r, clear, clear.cwiseProduct(Vector3d((-r * beta_d).array().exp()))});
    scattered_all.push_back({r, b_inf.cwiseProduct(Vector3d(1.0 - (-r * beta_b).array().exp()))});
  }
  const Medium medium = effective_medium(surfaces, scattered_all);
  EXPECT_TRUE(medium.beta_d.isApprox(beta_d, 1e-9));
  EXPECT_TRUE(medium.beta_b.isApprox(beta_b, 1e-5));
  EXPECT_TRUE(medium.b_inf.isApprox(b_inf, 1e-5));
}

// Root mean square distance of the light from the center of an image, per axis [px].
double width_of(const cv::Mat& image) {
  double sum = 0.0;
  double square = 0.0;
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const double light = image.at<cv::Vec3f>(y, x)[1];
      const double dx = x - image.cols / 2;
      const double dy = y - image.rows / 2;
      sum += light;
      square += 0.5 * light * (dx * dx + dy * dy);
    }
  }
  return std::sqrt(square / sum);
}

cv::Mat blurred_spot(float range) {
  cv::Mat spot = cv::Mat::zeros(241, 321, CV_32FC3);
  spot.at<cv::Vec3f>(120, 160) = {1.0F, 1.0F, 1.0F};
  cv::Mat image = cv::Mat::zeros(spot.size(), CV_32FC3);
  add_forward_blur({.focal_px = 200.0, .scattering = 0.3}, spot,
                   cv::Mat(spot.size(), CV_32F, cv::Scalar(range)), image);
  return image;
}

TEST(ForwardBlur, KeepsTheLightAndGrowsWithRange) {
  double before = 0.0;
  for (const float range : {0.5F, 3.0F, 10.0F}) {
    const cv::Mat image = blurred_spot(range);
    EXPECT_NEAR(cv::sum(image)[1], 1.0, 0.02) << range;
    EXPECT_GT(width_of(image), before) << range;
    before = width_of(image);
  }
}

TEST(ForwardBlur, HasTheWidthOfSingleScattering) {
  double square = 0.0;
  double all = 0.0;
  for (const AngleClass& angles : small_angle_classes()) {
    square += angles.fraction * angles.rms * angles.rms / 3.0;
    all += angles.fraction;
  }
  EXPECT_NEAR(width_of(blurred_spot(0.01F)), 200.0 * std::sqrt(square / all), 1.0);
}

TEST(ForwardBlur, LeavesEvenLightEven) {
  const cv::Mat even(100, 130, CV_32FC3, cv::Scalar::all(0.3));
  cv::Mat image = cv::Mat::zeros(even.size(), CV_32FC3);
  add_forward_blur({.focal_px = 200.0, .scattering = 0.3}, even,
                   cv::Mat(even.size(), CV_32F, cv::Scalar(4.0)), image);
  double low = 0.0;
  double high = 0.0;
  cv::minMaxLoc(image.reshape(1), &low, &high);
  EXPECT_NEAR(low, 0.3, 0.006);
  EXPECT_NEAR(high, 0.3, 0.006);
}

}  // namespace
}  // namespace apvi::sim
