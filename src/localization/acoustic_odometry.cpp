// SPDX-License-Identifier: BSD-3-Clause
#include "localization/acoustic_odometry.hpp"

#include <utility>
#include <variant>

namespace apvi::localization {
namespace {

// After this time the pose is output without an update report.
constexpr Duration kReportTimeout{50'000'000};

// Limits the queue when IMU data stop.
constexpr std::size_t kMaxPendingPings = 4096;

template <typename... F>
struct Overloaded : F... {
  using F::operator()...;
};

}  // namespace

std::vector<PingOutput> AcousticOdometry::process(const SensorEvent& event) {
  std::visit(Overloaded{[this](const ImuSample& s) { dipo_.add(s); },
                        [this](const DvlSample& s) {
                          pending_stamps_.push_back(s.stamp);
                          if (pending_stamps_.size() > kMaxPendingPings)
                            pending_stamps_.pop_front();
                          dipo_.add(s);
                        },
                        [this](const PressureSample& s) { dipo_.add(s); },
                        [this](const PressureDepthSample& s) { dipo_.add(s); },
                        [](const ImageFrame&) {}, [](const GnssSample&) {}},
             event);
  collect_reports();
  std::vector<PingOutput> outputs;
  while (!pending_stamps_.empty() && dipo_.initialized() &&
         dipo_.newest() >= pending_stamps_.front()) {
    const Stamp stamp = pending_stamps_.front();
    const auto report = reports_.find(stamp);
    if (report == reports_.end() && dipo_.newest() < stamp + kReportTimeout) break;
    if (const auto estimate = dipo_.at(stamp)) {
      outputs.push_back(
          {*estimate, report == reports_.end() ? dipo::Report{.stamp = stamp} : report->second});
    }
    pending_stamps_.pop_front();
  }
  return outputs;
}

void AcousticOdometry::collect_reports() {
  for (const dipo::Report& report : dipo_.take_dvl_reports()) {
    ++counts_.pings[report.verdict];
    reports_[report.stamp] = report;
  }
  for (const dipo::Report& report : dipo_.take_pressure_depth_reports())
    ++counts_.depths[report.verdict];
  constexpr std::size_t kMaxReports = 256;
  while (reports_.size() > kMaxReports) reports_.erase(reports_.begin());
}

}  // namespace apvi::localization
