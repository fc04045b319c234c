// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/place_store.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "floor_dive.hpp"

namespace apvi::loop_closure {
namespace {

constexpr int kMaxPlaces = 10;
constexpr double kLength_m = 6.0;

Path three_times_over_a_line() {
  const Path once = line(0.0, kLength_m, 0.0);
  return joined(joined(once, once), once);
}

/// The places of a dive and their positions along x.
struct Survey {
  Survey(const PlaceOptions& options, const Path& path) : store(options, floor_camera()) {
    for (std::size_t k = 0; k < path.size(); ++k) {
      graph.add({.stamp = Stamp{static_cast<std::int64_t>(k) * 600'000'000},
                 .T_world_camera = path[k],
                 .drift = {.heading = 1e-8, .horizontal = 1e-7, .vertical = 1e-8},
                 .height_sigma_m = std::nullopt});
      if (store.is_new_place(graph))
        store.store(graph, store.describe(graph, render_floor(path[k])));
    }
  }
  double nearest_m(double x, std::size_t before) const {
    double nearest = 1e9;
    for (const PlaceStore::Stored* stored : store.all()) {
      if (stored->keyframe >= before) continue;
      const double there = graph[stored->keyframe].T_world_camera.translation.x();
      nearest = std::min(nearest, std::abs(x - there));
    }
    return nearest;
  }
  KeyframeGraph graph{KeyframeGraphOptions{}};
  PlaceStore store;
};

TEST(PlaceStore, KeepsTheOldestPlacesEvenlySpreadWhenThereAreTooMany) {
  PlaceOptions options;
  options.max_places = kMaxPlaces;
  const Path path = three_times_over_a_line();
  const Survey survey(options, path);
  constexpr std::size_t kRecent = 4;
  EXPECT_LE(survey.store.all().size(), kMaxPlaces + kRecent);
  for (double x = 0.0; x < kLength_m; x += 0.5) {
    EXPECT_LT(survey.nearest_m(x, path.size() / 3), 1.0) << x;
  }
}

TEST(PlaceStore, KeepsEveryPlaceWhileThereIsRoom) {
  const Path path = line(0.0, kLength_m, 0.0);
  EXPECT_EQ(Survey({}, path).store.all().size(), path.size());
}

// Two views 0.3 m apart leave the depth of a point to 5 cm.
TEST(PlaceStore, PointsOfAPlaceComeFromItsWidestBaseline) {
  const Path path = line(0.0, 3.0, 0.0);
  const Survey survey({}, path);
  const PlaceStore::Stored& first = *survey.store.all().front();
  double squares = 0.0;
  for (const auto& point : first.place.points) {
    if (point) squares += std::pow(point->z() - kHeight_m, 2);
  }
  ASSERT_GT(first.triangulated, 50U);
  EXPECT_LT(std::sqrt(squares / static_cast<double>(first.triangulated)), 0.02);
}

// All points of a closer view are in the image too, but at another scale.
TEST(PlaceStore, ViewsFromASimilarDistanceAreTheBestCandidates) {
  Path path = line(0.0, 3.0, 0.0);
  const std::size_t similar = path.size();
  for (SE3 closer : line(0.0, 3.0, 0.6)) {
    closer.translation.z() = 0.6 * kHeight_m;
    path.push_back(closer);
  }
  for (const double x : {4.0, 4.3, 4.6, 4.9}) {
    path.push_back(camera_looking_down({x, 4.0, kHeight_m}, 0.0));
  }
  path.push_back(camera_looking_down({1.5, 0.6, kHeight_m}, 0.0));
  PlaceOptions options;
  options.min_age_s = 1.0;
  const Survey survey(options, path);
  const auto candidates = survey.store.candidates(survey.graph, 0);
  ASSERT_EQ(candidates.size(), 3U);
  for (const PlaceStore::Stored* candidate : candidates) EXPECT_LT(candidate->keyframe, similar);
}

}  // namespace
}  // namespace apvi::loop_closure
