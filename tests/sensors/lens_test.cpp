// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sensors/lens.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>
#include <utility>

namespace apvi {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

CameraModel::Parameters lens_of(std::optional<Distortion> distortion,
                                const std::vector<double>& coefficients) {
  CameraModel::Parameters camera;
  set_lens(distortion, coefficients, camera);
  return camera;
}

std::string error_of(std::optional<Distortion> distortion, const std::vector<double>& k) {
  try {
    lens_of(distortion, k);
  } catch (const std::invalid_argument& e) {
    return e.what();
  }
  return "";
}

TEST(Lens, IsInferredWhereOneModelFits) {
  EXPECT_EQ(lens_of({}, {}).distortion, Distortion::none);
  EXPECT_EQ(lens_of({}, {1, 2, 3, 4, 5}).distortion, Distortion::radtan);
  const auto rational = lens_of({}, {1, 2, 3, 4, 5, 6, 7, 8});
  EXPECT_EQ(rational.distortion, Distortion::radtan);
  EXPECT_EQ(rational.coefficients[7], 8.0);
}

TEST(Lens, IsDemandedWhereSeveralModelsFit) {
  EXPECT_THAT(error_of({}, {1, 2, 3, 4}),
              HasSubstr("4 coefficients fit radtan and equidistant: say which"));
  EXPECT_THAT(error_of({}, {0.1, 0.5}), HasSubstr("2 coefficients fit double_sphere and eucm"));
  EXPECT_THAT(error_of({}, {1, 2, 3}), HasSubstr("no lens model takes 3 coefficients; radtan"));
}

TEST(Lens, AWrongCountSaysWhichFit) {
  EXPECT_EQ(error_of(Distortion::radtan, {1, 2, 3, 4, 5, 6}),
            "radtan takes 4 or 5 or 8 coefficients, got 6");
  EXPECT_EQ(error_of(Distortion::eucm, {}), "eucm takes 2 coefficients, got 0");
  EXPECT_EQ(error_of(Distortion::none, {0.1}), "none takes 0 coefficients, got 1");
  EXPECT_EQ(lens_of(Distortion::none, {0, 0, 0, 0}).distortion, Distortion::none);
}

TEST(Lens, OutOfRangeCoefficientsSayTheirOrder) {
  EXPECT_THAT(error_of(Distortion::double_sphere, {0.5, 1.5}), HasSubstr("xi between -1 and 1"));
  EXPECT_THAT(error_of(Distortion::eucm, {1.5, 0.5}), HasSubstr("alpha from 0 to 1"));
  EXPECT_EQ(error_of(Distortion::eucm, {0.5, 1.5}), "");
}

TEST(Lens, TheShortestListSaysTheSame) {
  const auto shortest = [](Distortion distortion, const std::vector<double>& k) {
    return coefficients_of(lens_of(distortion, k));
  };
  EXPECT_THAT(shortest(Distortion::radtan, {1, 2, 3, 4, 0}), ElementsAre(1, 2, 3, 4));
  EXPECT_THAT(shortest(Distortion::radtan, {1, 0, 0, 0, 5}), ElementsAre(1, 0, 0, 0, 5));
  EXPECT_THAT(shortest(Distortion::radtan, {1, 0, 0, 0, 0, 0, 7, 0}),
              ElementsAre(1, 0, 0, 0, 0, 0, 7, 0));
  EXPECT_THAT(shortest(Distortion::equidistant, {0, 0, 0, 0}), ElementsAre(0, 0, 0, 0));
  EXPECT_THAT(shortest(Distortion::double_sphere, {0.1, 0.5}), ElementsAre(0.1, 0.5));
  EXPECT_TRUE(shortest(Distortion::none, {}).empty());
}

TEST(Lens, FocalLengthsAreTheScaleNearTheAxis) {
  for (const auto& [distortion, k] :
       {std::pair(Distortion::none, std::vector<double>{}),
        std::pair(Distortion::radtan, std::vector<double>{-0.2, 0.1, 0, 0}),
        std::pair(Distortion::double_sphere, std::vector<double>{-0.25, 0.6}),
        std::pair(Distortion::eucm, std::vector<double>{0.6, 1.2})}) {
    CameraModel::Parameters camera = lens_of(distortion, k);
    camera.fx = 200.0;
    camera.fy = 210.0;
    const Eigen::Vector2d pixel = *CameraModel(camera).project({1e-5, 1e-5, 1.0});
    EXPECT_NEAR(pixel.x() / 1e-5, focal_lengths(camera).x(), 1e-4);
    EXPECT_NEAR(pixel.y() / 1e-5, focal_lengths(camera).y(), 1e-4);
  }
}

}  // namespace
}  // namespace apvi
