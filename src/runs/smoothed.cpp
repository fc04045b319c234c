// SPDX-License-Identifier: BSD-3-Clause
#include "runs/smoothed.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <span>
#include <vector>

#include "apvi/core/constants.hpp"
#include "apvi/core/log.hpp"
#include "apvi/geometry/so3.hpp"

namespace apvi::runs {
namespace {

struct Largest {
  double shift_m = 0.0;
  double turn_deg = 0.0;
};

Largest largest_correction(const Trajectory& odometry, const Trajectory& smoothed,
                           const SE3& T_world_known) {
  Largest largest;
  for (std::size_t i = 0; i < odometry.size(); ++i) {
    const SE3& a = odometry.poses[i].T_world_body;
    const SE3 b = T_world_known * smoothed.poses[i].T_world_body;
    largest.shift_m = std::max(largest.shift_m, (b.translation - a.translation).norm());
    largest.turn_deg =
        std::max(largest.turn_deg, kDegreesPerRadian * so3::angle_between(a.rotation, b.rotation));
  }
  return largest;
}

double quantile_ms(std::span<const double> all, double part) {
  std::vector<double> seconds(all.begin(), all.end());
  const auto at = static_cast<std::ptrdiff_t>(part * static_cast<double>(seconds.size() - 1));
  std::nth_element(seconds.begin(), seconds.begin() + at, seconds.end());
  return 1e3 * seconds[static_cast<std::size_t>(at)];
}

}  // namespace

eval::Json smoothed_json(const localization::Smoother& smoother, const Trajectory& odometry,
                         const Trajectory& smoothed, const eval::TrajectoryMetrics& metrics) {
  eval::Json json = eval::to_json(metrics);
  json["closed_loops"] = smoother.closer().closures();
  json["rejected_loops"] = smoother.closer().rejected();
  json["breaks"] = smoother.closer().breaks();
  json["reconnections"] = smoother.closer().reconnections();
  const Largest largest =
      largest_correction(odometry, smoothed, smoother.closer().graph().T_world_known());
  json["largest_correction_m"] = largest.shift_m;
  json["largest_correction_deg"] = largest.turn_deg;
  const std::vector<double>& seconds = smoother.keyframe_seconds();
  if (seconds.empty()) return json;
  const std::size_t sixth = std::max<std::size_t>(1, seconds.size() / 6);
  const std::span<const double> all(seconds);
  json["keyframe_ms"] = {{"median", quantile_ms(all, 0.5)},
                         {"p95", quantile_ms(all, 0.95)},
                         {"p95_first_sixth", quantile_ms(all.first(sixth), 0.95)},
                         {"p95_last_sixth", quantile_ms(all.last(sixth), 0.95)}};
  return json;
}

void warn_about_breaks(const localization::Smoother& smoother, std::vector<std::string>& warnings) {
  const std::size_t breaks = smoother.closer().breaks();
  const std::size_t found = smoother.closer().reconnections();
  if (breaks == found) return;
  warnings.push_back(fmt::format(
      "trajectory: odometry was lost {}; the images {} were not recognized as a place seen before, "
      "so heading and position since then do not refer to those before",
      breaks == 1 ? "once" : fmt::format("{} times", breaks),
      breaks == 1 ? "afterwards" : fmt::format("after {} of them", breaks - found)));
  log::warning("{}", warnings.back());
}

}  // namespace apvi::runs
