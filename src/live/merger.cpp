// SPDX-License-Identifier: BSD-3-Clause
#include "live/merger.hpp"

#include <algorithm>
#include <utility>
#include <variant>

#include "apvi/core/log.hpp"

namespace apvi::live {
namespace {

constexpr Duration kLatenessPeriod{5'000'000'000};
// A little more than ever seen, for the next one.
constexpr Duration kMargin{5'000'000};

std::string name_of(const SensorEvent& event) {
  std::string name(kind_of(event));
  if (const auto* image = std::get_if<ImageFrame>(&event)) name += std::to_string(image->camera);
  return name;
}

}  // namespace

void Merger::Lateness::add(Duration lateness, Stamp now) {
  if (now - since >= kLatenessPeriod) {
    largest = {lateness, largest[0]};
    since = now;
  }
  largest[0] = std::max(largest[0], lateness);
}

Duration Merger::Lateness::expected() const {
  return std::max({largest[0], largest[1], Duration{}}) + kMargin;
}

void Merger::add(SensorEvent event, Stamp arrival) {
  const Stamp stamp = stamp_of(event);
  const std::string name = name_of(event);
  Stream& stream = streams_[name];
  stream.lateness.add(arrival - stamp, arrival);
  stream.newest = std::max(stream.newest, stamp);
  stream.last_arrival = arrival;
  if (stamp < delivered_) {
    if (++late_[name] == 1) {
      log::warning("{}: a sample came {:.0f} ms too late and is dropped; others are only counted",
                   name, 1e3 * seconds_between(stamp, delivered_));
    }
    return;
  }
  waiting_.emplace(stamp, Waiting{std::move(event), arrival});
  advance(arrival);
}

bool Merger::is_due(Stamp stamp, const Waiting& waiting, Stamp now) const {
  if (now - waiting.arrival >= Duration::from_seconds(options_.max_wait_s)) return true;
  const auto has_passed = [&](const auto& entry) {
    const Stream& stream = entry.second;
    return stream.newest >= stamp ||
           now - stream.last_arrival >= Duration::from_seconds(options_.silent_s) ||
           now - stamp >= stream.lateness.expected();
  };
  return std::ranges::all_of(streams_, has_passed);
}

void Merger::advance(Stamp now) {
  while (!waiting_.empty()) {
    const auto& [stamp, waiting] = *waiting_.begin();
    if (!is_due(stamp, waiting, now)) return;
    deliver_first();
  }
}

void Merger::finish() {
  while (!waiting_.empty()) deliver_first();
}

void Merger::deliver_first() {
  auto first = waiting_.extract(waiting_.begin());
  delivered_ = first.key();
  deliver_(std::move(first.mapped().event), first.mapped().arrival);
}

}  // namespace apvi::live
