// SPDX-License-Identifier: BSD-3-Clause
// Speed of acoustic-inertial odometry (no camera), and memory growth over the length of a run.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "core/stopwatch.hpp"
#include "localization/acoustic_odometry.hpp"
#include "synthetic_dive.hpp"

namespace apvi::bench {
namespace {

constexpr Duration kChunk{10'000'000'000};
constexpr Duration kWarmUp{60'000'000'000};  // memory growth is measured from here

struct Outcome {
  double wall_s = 0.0;
  double rss_peak_mib = 0.0;
  double rss_growth_mib = 0.0;
  double range_error_m = 0.0;  // error of the start-to-end distance, independent of the frame
  std::size_t poses = 0;
};

double range_error(const dipo::Estimate& first, const dipo::Estimate& last,
                   const SyntheticDive& dive) {
  const double estimated = (last.state.nav.p_world - first.state.nav.p_world).norm();
  const double true_range = (dive.position_at(last.stamp) - dive.position_at(first.stamp)).norm();
  return std::abs(estimated - true_range);
}

// Processes every sample of the dive; only the processing is timed.
Outcome run_localization(SyntheticDive& dive) {
  localization::AcousticOdometry localization({}, dive.rig());
  Outcome outcome;
  double rss_early = 0.0;
  std::optional<dipo::Estimate> first;
  std::optional<dipo::Estimate> last;
  for (auto events = dive.next(kChunk); !events.empty(); events = dive.next(kChunk)) {
    const Stopwatch watch;
    for (const SensorEvent& event : events) {
      for (const auto& output : localization.process(event)) {
        ++outcome.poses;
        if (!first) first = output.estimate;
        last = output.estimate;
      }
    }
    outcome.wall_s += watch.seconds();
    const double rss = resident_mib();
    outcome.rss_peak_mib = std::max(outcome.rss_peak_mib, rss);
    if (stamp_of(events.back()) <= dive.start() + kWarmUp) rss_early = outcome.rss_peak_mib;
  }
  outcome.rss_growth_mib = outcome.rss_peak_mib - rss_early;
  if (first) outcome.range_error_m = range_error(*first, *last, dive);
  return outcome;
}

void localization(benchmark::State& state) {
  const double duration_s = 60.0 * static_cast<double>(state.range(0));
  const Rates rates{.imu = static_cast<double>(state.range(1)),
                    .dvl = static_cast<double>(state.range(2)),
                    .pressure = 10.0};
  Outcome outcome;
  for ([[maybe_unused]] auto _ : state) {
    SyntheticDive dive(rates, duration_s);
    outcome = run_localization(dive);
    state.SetIterationTime(outcome.wall_s);
  }
  if (outcome.poses == 0) state.SkipWithError("no pose was estimated");
  state.SetItemsProcessed(
      static_cast<std::int64_t>(static_cast<double>(state.iterations()) * duration_s *
                                (rates.imu + rates.dvl + rates.pressure)));
  state.counters["realtime_factor"] = benchmark::Counter(
      duration_s * static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
  state.counters["rss_peak_mib"] = outcome.rss_peak_mib;
  state.counters["rss_growth_mib"] = outcome.rss_growth_mib;
  state.counters["range_error_m"] = outcome.range_error_m;
}

BENCHMARK(localization)
    ->ArgNames({"minutes", "imu_hz", "dvl_hz"})
    ->ArgsProduct({{10, 60}, {100, 200}, {5, 8}})
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace apvi::bench
