// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/medium/medium_schedule.hpp"

#include <torch/serialize/archive.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "gaussians/model/archive.hpp"

namespace apvi::mapping {
namespace {

constexpr double kGrowthFactor = 1.4;  // in keyframes, from one estimation to the next
constexpr std::size_t kMaxInterval =
    300;  // keyframes, some minutes: the water changes on a long dive
constexpr std::size_t kAfterOutage = 20;  // keyframes, in which the map must first be extended
constexpr std::size_t kMergeMargin = 10;  // a regular estimation so close before replaces it

constexpr std::int64_t kNone = -1;

}  // namespace

void MediumSchedule::images_resumed(std::size_t keyframes) {
  after_outage_ = keyframes + kAfterOutage;
}

bool MediumSchedule::is_due(std::size_t keyframes) const {
  if (keyframes < first_) return false;
  const auto grown =
      static_cast<std::size_t>(std::ceil(kGrowthFactor * static_cast<double>(last_)));
  return keyframes >= std::min(grown, last_ + kMaxInterval) ||
         (after_outage_ && keyframes >= *after_outage_);
}

void MediumSchedule::mark_estimated(std::size_t keyframes) {
  last_ = keyframes;
  if (after_outage_ && keyframes + kMergeMargin >= *after_outage_) after_outage_.reset();
}

void MediumSchedule::save(torch::serialize::OutputArchive& archive) const {
  archive.write("last", c10::IValue(static_cast<std::int64_t>(last_)));
  archive.write("after_outage",
                c10::IValue(after_outage_ ? static_cast<std::int64_t>(*after_outage_) : kNone));
}

void MediumSchedule::load(torch::serialize::InputArchive& archive) {
  last_ = static_cast<std::size_t>(gaussians::read_int(archive, "last"));
  const std::int64_t after_outage = gaussians::read_int(archive, "after_outage");
  after_outage_.reset();
  if (after_outage != kNone) after_outage_ = static_cast<std::size_t>(after_outage);
}

}  // namespace apvi::mapping
