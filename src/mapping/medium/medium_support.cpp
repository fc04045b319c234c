// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/medium/medium_support.hpp"

#include <torch/torch.h>

#include <algorithm>

#include "gaussians/model/archive.hpp"

namespace apvi::mapping {
namespace {

constexpr double kForgetting = 0.8;  // as for the medium
// In a room, errors of the map alone saved 0.09 of each of 480 observations and 0.02 and less of
// more; water saved 0.16 to 0.27 on a reef at one to four meters and 0.03 to 0.18 on a simulated
// one. 0.06 is 6 % of the variance of the colors.
constexpr double kNeededPerObservation = 0.06;
constexpr double kSignificant = 60.0;  // nine parameters save 28 by chance in one of 1,000 cases

}  // namespace

void MediumSupport::add(double saved_deviance, std::int64_t observations) {
  observations_ = kForgetting * observations_ + static_cast<double>(observations);
  sum_ = kForgetting * sum_ + saved_deviance;
  weight_ = kForgetting * weight_ + 1.0;
}

double MediumSupport::saved_deviance() const {
  return sum_ / std::max(1.0, weight_);
}

double MediumSupport::saved_per_observation() const {
  return sum_ / std::max(1.0, observations_);
}

bool MediumSupport::is_sufficient() const {
  return saved_deviance() > kSignificant && saved_per_observation() > kNeededPerObservation;
}

void MediumSupport::save(torch::serialize::OutputArchive& archive) const {
  archive.write("sum", torch::IValue(sum_));
  archive.write("observations", torch::IValue(observations_));
  archive.write("weight", torch::IValue(weight_));
}

void MediumSupport::load(torch::serialize::InputArchive& archive) {
  sum_ = gaussians::read_double(archive, "sum");
  observations_ = gaussians::read_double(archive, "observations");
  weight_ = gaussians::read_double(archive, "weight");
}

}  // namespace apvi::mapping
