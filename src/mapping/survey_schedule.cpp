// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/survey_schedule.hpp"

#include <torch/serialize/archive.h>

#include <cmath>
#include <cstdint>

#include "archive.hpp"

namespace apvi::mapping {
namespace {

constexpr double kGrowth = 1.4;  // in keyframes, from one survey to the next
// After an outage: the map must first learn what came into sight.
constexpr std::size_t kAfterOutage = 20;
constexpr std::size_t kEnough = 10;  // of these, for a survey that comes by itself

constexpr std::int64_t kNone = -1;

}  // namespace

void SurveySchedule::sight_returned(std::size_t taken) {
  after_outage_ = taken + kAfterOutage;
}

bool SurveySchedule::is_due(std::size_t taken) const {
  if (taken < first_) return false;
  const auto grown = static_cast<std::size_t>(std::ceil(kGrowth * static_cast<double>(last_)));
  return taken >= grown || (after_outage_ && taken >= *after_outage_);
}

void SurveySchedule::surveyed(std::size_t taken) {
  last_ = taken;
  if (after_outage_ && taken + kEnough >= *after_outage_) after_outage_.reset();
}

void SurveySchedule::save(torch::serialize::OutputArchive& archive) const {
  archive.write("last", c10::IValue(static_cast<std::int64_t>(last_)));
  archive.write("after_outage",
                c10::IValue(after_outage_ ? static_cast<std::int64_t>(*after_outage_) : kNone));
}

void SurveySchedule::load(torch::serialize::InputArchive& archive) {
  last_ = static_cast<std::size_t>(read_int(archive, "last"));
  const std::int64_t after_outage = read_int(archive, "after_outage");
  after_outage_.reset();
  if (after_outage != kNone) after_outage_ = static_cast<std::size_t>(after_outage);
}

}  // namespace apvi::mapping
