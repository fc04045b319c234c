// SPDX-License-Identifier: BSD-3-Clause
#include "survey/survey_map.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <vector>

#include "apvi/core/error.hpp"
#include "survey/flat_ground.hpp"
#include "survey/visibility.hpp"

namespace apvi::survey {
namespace {

TEST(BoundsOf, APlaneKeepsItsEdges) {
  const GroundBounds bounds = bounds_of(test::plane_map({}));
  EXPECT_NEAR(bounds.west, -0.99, 1e-6);
  EXPECT_NEAR(bounds.east, 0.99, 1e-6);
  EXPECT_NEAR(bounds.south, -0.99, 1e-6);
  EXPECT_NEAR(bounds.north, 0.99, 1e-6);
}

TEST(BoundsOf, AFarGaussianAndATransparentOneDoNotCount) {
  SurveyMap map = test::plane_map({});
  map.map.gaussians.means[0][0] = -500.0;
  map.map.gaussians.means[1][1] = 1.5;
  map.map.gaussians.logit_opacities[1] = -2.0;
  const GroundBounds bounds = bounds_of(map);
  EXPECT_GT(bounds.west, -1.3);
  EXPECT_NEAR(bounds.north, 0.99, 1e-6);
}

TEST(BoundsOf, AMapWithoutASurfaceIsRefused) {
  SurveyMap map = test::plane_map({});
  map.map.gaussians.logit_opacities.fill_(-3.0);
  EXPECT_THROW(bounds_of(map), InputError);
  map.map.gaussians = gaussians::Gaussians::empty(0, torch::kFloat32);
  EXPECT_THROW(bounds_of(map), InputError);
}

/// A camera at x and at a height, that looks straight down.
gaussians::View looking_down(double x, double height_m) {
  gaussians::View view;
  view.intrinsics = {.fx = 50.0, .fy = 50.0, .cx = 50.0, .cy = 50.0, .width = 100, .height = 100};
  view.T_camera_world = torch::tensor({{1.0, 0.0, 0.0, -x},
                                       {0.0, -1.0, 0.0, 0.0},
                                       {0.0, 0.0, -1.0, height_m},
                                       {0.0, 0.0, 0.0, 1.0}},
                                      torch::kFloat64);
  return view;
}

SurveyMap points_map(const torch::Tensor& means, const SE3& T_crs_map = {}) {
  SurveyMap map = test::plane_map({.side_m = 0.2, .spacing_m = 0.1}, T_crs_map);
  for (torch::Tensor* tensor : map.map.gaussians.tensors()) {
    *tensor = tensor->slice(0, 0, 1).repeat_interleave(means.size(0), 0);
  }
  map.map.gaussians.means = means;
  return map;
}

TEST(SeenFromAbove, WhatThreeImagesShowBelowTheCamerasIsKept) {
  const torch::Tensor means = torch::tensor({{0.0F, 0.0F, 0.0F},      // seen by all
                                             {0.0F, 0.2F, 0.0F},      // the same
                                             {2.1F, 0.0F, 0.0F},      // seen by one
                                             {0.0F, 0.0F, 2.5F},      // above the cameras
                                             {0.0F, 0.0F, -50.0F}});  // background
  const SurveyMap kept = seen_from_above(
      points_map(means), {looking_down(0.0, 2.0), looking_down(0.1, 2.0), looking_down(0.2, 2.0)});
  EXPECT_TRUE(torch::equal(kept.map.gaussians.means, means.slice(0, 0, 2)));
}

TEST(SeenFromAbove, CamerasOfOtherPlacesDoNotCount) {
  // The seabed rises by 5 m; where it is high the cameras are, too.
  const torch::Tensor means = torch::tensor({{0.0F, 0.0F, 0.0F}, {10.0F, 0.0F, 5.0F}});
  std::vector<gaussians::View> views;
  for (const double shift : {0.0, 0.1, 0.2}) {
    views.push_back(looking_down(shift, 2.0));
    views.push_back(looking_down(10.0 + shift, 7.0));
  }
  EXPECT_EQ(seen_from_above(points_map(means), views).map.gaussians.size(), 2);
}

TEST(SeenFromAbove, DependsOnTheMapAloneNotOnItsPlace) {
  // A world with z down.
  const SE3 T{Eigen::Quaterniond(0.0, std::sqrt(0.5), std::sqrt(0.5), 0.0), {7e5, 5e6, 3.0}};
  gaussians::View view = looking_down(0.0, 0.0);
  view.T_camera_world = torch::eye(4, torch::kFloat64);  // looks along z, which is down
  const torch::Tensor means = torch::tensor({{0.0F, 0.0F, 2.0F}, {0.1F, 0.0F, 2.0F}});
  EXPECT_EQ(seen_from_above(points_map(means, T), {view}).map.gaussians.size(), 2);
}

TEST(SeenFromAbove, WithoutViewsNothingIsRemoved) {
  EXPECT_EQ(seen_from_above(test::plane_map({}), {}).map.gaussians.size(), 10000);
}

}  // namespace
}  // namespace apvi::survey
