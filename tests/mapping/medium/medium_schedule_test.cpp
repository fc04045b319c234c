// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/medium/medium_schedule.hpp"

#include <gtest/gtest.h>
#include <torch/serialize/archive.h>

#include <sstream>
#include <vector>

namespace apvi::mapping {
namespace {

/// Keyframe counts up to `max_keyframes` at which an estimation is due; images resume at `resumed`.
std::vector<std::size_t> estimations(MediumSchedule& schedule, std::size_t from,
                                     std::size_t max_keyframes, std::size_t resumed = 0) {
  std::vector<std::size_t> after;
  for (std::size_t keyframes = from; keyframes <= max_keyframes; ++keyframes) {
    if (keyframes == resumed) schedule.images_resumed(keyframes);
    if (!schedule.is_due(keyframes)) continue;
    schedule.mark_estimated(keyframes);
    after.push_back(keyframes);
  }
  return after;
}

TEST(MediumSchedule, IsDueAfterFortyPercentMoreKeyframes) {
  MediumSchedule schedule(10);
  EXPECT_EQ(estimations(schedule, 1, 60), (std::vector<std::size_t>{10, 14, 20, 28, 40, 56}));
}

TEST(MediumSchedule, IsDueEvery300KeyframesOnALongDive) {
  MediumSchedule schedule(1000);
  EXPECT_EQ(estimations(schedule, 1, 1900), (std::vector<std::size_t>{1000, 1300, 1600, 1900}));
}

TEST(MediumSchedule, IsDueTwentyKeyframesAfterAnOutage) {
  MediumSchedule schedule(100);
  EXPECT_EQ(estimations(schedule, 1, 170, 105), (std::vector<std::size_t>{100, 125}));
}

// The estimation at the first keyframe after the outage has not seen the new area yet.
TEST(MediumSchedule, EstimationRightAfterAnOutageDoesNotReplaceTheLaterOne) {
  MediumSchedule schedule(100);
  EXPECT_EQ(estimations(schedule, 1, 170, 140), (std::vector<std::size_t>{100, 140, 160}));
}

TEST(MediumSchedule, EstimationWellAfterAnOutageReplacesTheLaterOne) {
  MediumSchedule schedule(100);
  EXPECT_EQ(estimations(schedule, 1, 170, 130), (std::vector<std::size_t>{100, 140}));
}

TEST(MediumSchedule, ContinuesFromAnArchive) {
  MediumSchedule schedule(10);
  estimations(schedule, 1, 120, 115);
  std::stringstream stream;
  torch::serialize::OutputArchive out;
  schedule.save(out);
  out.save_to(stream);
  torch::serialize::InputArchive in;
  in.load_from(stream);
  MediumSchedule loaded(10);
  loaded.load(in);
  EXPECT_EQ(estimations(loaded, 121, 250), estimations(schedule, 121, 250));
}

}  // namespace
}  // namespace apvi::mapping
