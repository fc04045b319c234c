// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/survey_schedule.hpp"

#include <gtest/gtest.h>
#include <torch/serialize/archive.h>

#include <sstream>
#include <vector>

namespace apvi::mapping {
namespace {

/// Surveys whenever one is due, up to `most` keyframes; sight returns with the one numbered so.
std::vector<std::size_t> surveys(SurveySchedule& schedule, std::size_t from, std::size_t most,
                                 std::size_t sight_returns = 0) {
  std::vector<std::size_t> after;
  for (std::size_t taken = from; taken <= most; ++taken) {
    if (taken == sight_returns) schedule.sight_returned(taken);
    if (!schedule.is_due(taken)) continue;
    schedule.surveyed(taken);
    after.push_back(taken);
  }
  return after;
}

TEST(SurveySchedule, SurveysAgainWhenThereAreFourTenthsMoreKeyframes) {
  SurveySchedule schedule(10);
  EXPECT_EQ(surveys(schedule, 1, 60), (std::vector<std::size_t>{10, 14, 20, 28, 40, 56}));
}

TEST(SurveySchedule, SurveysTwentyKeyframesAfterAnOutage) {
  SurveySchedule schedule(100);
  EXPECT_EQ(surveys(schedule, 1, 170, 105), (std::vector<std::size_t>{100, 125}));
}

// The one on the first keyframe in sight again cannot have looked at what came into sight.
TEST(SurveySchedule, ASurveyJustAfterAnOutageDoesNotReplaceTheLaterOne) {
  SurveySchedule schedule(100);
  EXPECT_EQ(surveys(schedule, 1, 170, 140), (std::vector<std::size_t>{100, 140, 160}));
}

TEST(SurveySchedule, ASurveyOfAStretchAfterAnOutageIsEnough) {
  SurveySchedule schedule(100);
  EXPECT_EQ(surveys(schedule, 1, 170, 130), (std::vector<std::size_t>{100, 140}));
}

TEST(SurveySchedule, GoesOnFromAnArchive) {
  SurveySchedule schedule(10);
  surveys(schedule, 1, 120, 115);
  std::stringstream stream;
  torch::serialize::OutputArchive out;
  schedule.save(out);
  out.save_to(stream);
  torch::serialize::InputArchive in;
  in.load_from(stream);
  SurveySchedule loaded(10);
  loaded.load(in);
  EXPECT_EQ(surveys(loaded, 121, 250), surveys(schedule, 121, 250));
}

}  // namespace
}  // namespace apvi::mapping
