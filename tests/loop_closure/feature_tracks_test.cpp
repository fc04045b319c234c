// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/feature_tracks.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "bundle_dive.hpp"

namespace apvi::loop_closure {
namespace {

constexpr double kTolerance = 10.0 / kFocal;

std::vector<TrackView> views_of(const BundleDive& dive) {
  std::vector<TrackView> views;
  for (std::size_t k = 0; k < dive.views.size(); ++k) {
    views.push_back({&dive.places[k], dive.truth[k] * mounting()});
  }
  return views;
}

bool contains(const std::vector<std::pair<std::size_t, std::size_t>>& pairs, std::size_t a,
              std::size_t b) {
  return std::ranges::find(pairs, std::pair{a, b}) != pairs.end();
}

TEST(OverlappingViews, NeighborsInTimeAndInSpaceArePaired) {
  const BundleDive dive = bundle_dive();
  const auto pairs = overlapping_views(views_of(dive), test::floor_camera());
  EXPECT_TRUE(contains(pairs, 4, 5));
  EXPECT_TRUE(contains(pairs, 4, 7));
  EXPECT_FALSE(contains(pairs, 0, 10));  // 4 m apart
  for (const auto& [a, b] : pairs) EXPECT_LT(a, b);
}

TEST(FeatureTracks, ATrackShowsOnePoint) {
  const BundleDive dive = bundle_dive();
  const std::vector<TrackView> views = views_of(dive);
  const auto tracks =
      track_features(views, overlapping_views(views, test::floor_camera()), kTolerance);
  ASSERT_GT(tracks.size(), 300U);
  for (const FeatureTrack& track : tracks) {
    std::set<std::size_t> seen;
    const auto& first = dive.places[track[0].view];
    for (const TrackedFeature& feature : track) {
      EXPECT_TRUE(seen.insert(feature.view).second);
      const Place& place = dive.places[feature.view];
      EXPECT_EQ(squared_distance(first.descriptors.ptr(static_cast<int>(track[0].feature)),
                                 place.descriptors.ptr(static_cast<int>(feature.feature))),
                0);
    }
  }
}

TEST(FeatureTracks, APairThatContradictsItsPosesIsNotMatched) {
  const BundleDive dive = bundle_dive();
  std::vector<TrackView> views = views_of(dive);
  views.resize(2);
  EXPECT_FALSE(track_features(views, {{0, 1}}, kTolerance).empty());
  views[1].T_world_camera.rotation = views[1].T_world_camera.rotation * so3::exp({0.3, 0.2, 0.0});
  EXPECT_TRUE(track_features(views, {{0, 1}}, kTolerance).empty());
}

}  // namespace
}  // namespace apvi::loop_closure
