// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/pipeline/localization.hpp"

#include <utility>
#include <variant>

namespace apvi::pipeline {
namespace {

// Without a verdict after this long the pose goes out as it is.
constexpr Duration kPatience{50'000'000};

// Pings kept waiting at the most, should the inertial data stop.
constexpr std::size_t kMostWanted = 4096;

template <typename... F>
struct Overloaded : F... {
  using F::operator()...;
};

}  // namespace

std::vector<LocalizationOutput> Localization::process(const SensorEvent& event) {
  std::visit(Overloaded{[this](const ImuSample& s) { dipo_.add(s); },
                        [this](const DvlSample& s) {
                          wanted_.push_back(s.stamp);
                          if (wanted_.size() > kMostWanted) wanted_.pop_front();
                          dipo_.add(s);
                        },
                        [this](const PressureSample& s) { dipo_.add(s); },
                        [this](const DepthSample& s) { dipo_.add(s); }, [](const ImageFrame&) {},
                        [](const GnssSample&) {}},
             event);
  take_reports();
  std::vector<LocalizationOutput> outputs;
  while (!wanted_.empty() && dipo_.initialized() && dipo_.newest() >= wanted_.front()) {
    const Stamp stamp = wanted_.front();
    const auto report = reports_.find(stamp);
    if (report == reports_.end() && dipo_.newest() < stamp + kPatience) break;
    if (const auto estimate = dipo_.at(stamp)) {
      outputs.push_back(
          {*estimate, report == reports_.end() ? dipo::Report{.stamp = stamp} : report->second});
    }
    wanted_.pop_front();
  }
  return outputs;
}

void Localization::take_reports() {
  for (const dipo::Report& report : dipo_.take_dvl_reports()) {
    ++counts_.pings[report.verdict];
    reports_[report.stamp] = report;
  }
  for (const dipo::Report& report : dipo_.take_depth_reports()) ++counts_.depths[report.verdict];
  constexpr std::size_t kKeep = 256;
  while (reports_.size() > kKeep) reports_.erase(reports_.begin());
}

}  // namespace apvi::pipeline
