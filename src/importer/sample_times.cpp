// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <optional>

#include "core/median.hpp"
#include "importer/telemetry.hpp"

namespace apvi::importer {
namespace {

struct Place {
  double start_s = 0.0;
  double duration_s = 0.0;  // of the payload
  std::size_t count = 0;
};

// Video time minus the camera's clock. Exposures are those of the images, so the first one is that
// of the payload's beginning; other sensors may begin a little later.
std::optional<double> clock_offset(const std::vector<TimedPayload>& payloads) {
  for (const char* key : {"SHUT", "ISOE", "ISOG", "ACCL", "GYRO"}) {
    const GpmfStream* stream = payloads.empty() ? nullptr : payloads.front().payload.find(key);
    if (stream != nullptr && stream->stamp_s) return payloads.front().time_s - *stream->stamp_s;
  }
  return std::nullopt;
}

// Starts by STMP; empty if a payload lacks it or they do not increase.
std::vector<Place> places_by_stamp(const std::vector<TimedPayload>& payloads,
                                   const std::string& key) {
  std::vector<Place> places;
  const auto offset = clock_offset(payloads);
  for (const TimedPayload& p : payloads) {
    const GpmfStream* stream = p.payload.find(key);
    if (stream == nullptr || stream->size() == 0) continue;
    if (!offset || !stream->stamp_s) return {};
    places.push_back({*stream->stamp_s + *offset, p.duration_s, stream->size()});
    const std::size_t n = places.size();
    if (n > 1 && !(places[n - 1].start_s > places[n - 2].start_s)) return {};
  }
  return places;
}

// The payload after a gap does not tell the period.
double period(const std::vector<Place>& places, std::size_t i) {
  const auto own = [&](std::size_t k) {
    return (places[k + 1].start_s - places[k].start_s) / static_cast<double>(places[k].count);
  };
  if (places.size() == 1) return places[0].duration_s / static_cast<double>(places[0].count);
  std::vector<double> all;
  for (std::size_t k = 0; k + 1 < places.size(); ++k) all.push_back(own(k));
  const double last = i + 1 < places.size() ? own(i) : all.back();
  return std::min(last, 1.2 * median(std::move(all)));
}

std::vector<double> spread(const std::vector<Place>& places) {
  std::vector<double> times;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const double step = period(places, i);
    for (std::size_t k = 0; k < places[i].count; ++k) {
      times.push_back(places[i].start_s + step * static_cast<double>(k));
    }
  }
  return times;
}

// Payloads that follow each other, as one.
std::vector<Place> runs_of_payloads(const std::vector<TimedPayload>& payloads,
                                    const std::string& key) {
  constexpr double kGap_s = 0.1;  // shorter ones are the rounding of clocks
  std::vector<Place> runs;
  for (const TimedPayload& p : payloads) {
    const GpmfStream* stream = p.payload.find(key);
    if (stream == nullptr) continue;
    const double end = runs.empty() ? 0.0 : runs.back().start_s + runs.back().duration_s;
    if (runs.empty() || p.time_s - end > kGap_s) runs.push_back({.start_s = p.time_s});
    runs.back().duration_s += p.duration_s;
    runs.back().count += stream->size();
  }
  return runs;
}

// The number of samples in a payload jitters with the camera's load, the sensor's clock does not.
std::vector<double> evenly_spaced(const std::vector<TimedPayload>& payloads,
                                  const std::string& key) {
  std::vector<double> times;
  for (const Place& run : runs_of_payloads(payloads, key)) {
    for (std::size_t i = 0; i < run.count; ++i) {
      times.push_back(run.start_s +
                      run.duration_s * static_cast<double>(i) / static_cast<double>(run.count));
    }
  }
  return times;
}

}  // namespace

std::vector<double> sample_times(const std::vector<TimedPayload>& payloads,
                                 const std::string& key) {
  const std::vector<Place> places = places_by_stamp(payloads, key);
  return places.empty() ? evenly_spaced(payloads, key) : spread(places);
}

}  // namespace apvi::importer
