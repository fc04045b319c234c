// SPDX-License-Identifier: BSD-3-Clause
#include "live/session.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "live/host_clock.hpp"

namespace apvi::live {
namespace {

constexpr std::chrono::milliseconds kWatchPeriod{5};

// The merger makes the order, and the clocks are aligned: no sample waits again.
constexpr io::LiveOptions kMerged{.reorder_s = 0.0, .max_time_jump_s = 1e6, .confirm_first = false};

}  // namespace

Session::Session(std::vector<std::unique_ptr<Source>> sources, config::Node rig,
                 SessionOptions options)
    : options_(std::move(options)),
      sequence_(std::move(rig), kMerged),
      merger_({.max_wait_s = options_.max_wait_s},
              [this](const SensorEvent& event, Stamp arrival) { deliver(event, arrival); }),
      sources_(std::move(sources)) {}

void Session::start(std::function<bool()> interrupted) {
  for (const auto& source : sources_) {
    source->start([this](SensorEvent event, Stamp arrival) { take(std::move(event), arrival); });
  }
  watcher_ = std::jthread([this, interrupted = std::move(interrupted)](
                              const std::stop_token& stop) { watch(stop, interrupted); });
}

void Session::stop() {
  watcher_.request_stop();
  sequence_.stop();  // unblocks the sources
  for (const auto& source : sources_) source->request_stop();
  for (const auto& source : sources_) source->stop();
  if (watcher_.joinable()) watcher_.join();
}

void Session::take(SensorEvent event, Stamp arrival) {
  const std::scoped_lock lock(mutex_);
  merger_.add(std::move(event), arrival);
}

void Session::deliver(const SensorEvent& event, Stamp arrival) {
  if (!sequence_.push(event)) return;  // over
  if (options_.recorder != nullptr) options_.recorder->push(event);
  if (options_.latency != nullptr && kind_of(event) == options_.latency_kind) {
    options_.latency->arrived(stamp_of(event), arrival);
  }
}

void Session::watch(const std::stop_token& stop, const std::function<bool()>& interrupted) {
  const Stamp began = host_now();
  while (!stop.stop_requested()) {
    const Stamp now = host_now();
    const bool over =
        options_.duration_s > 0.0 && seconds_between(began, now) >= options_.duration_s;
    if (interrupted()) return sequence_.stop();
    if (advance(now, over)) return sequence_.finish();
    std::this_thread::sleep_for(kWatchPeriod);
  }
}

// True at the end.
bool Session::advance(Stamp now, bool over) {
  const std::scoped_lock lock(mutex_);
  merger_.advance(now);
  if (!over && !all_ended()) return false;
  merger_.finish();
  return true;
}

bool Session::all_ended() const {
  return std::ranges::all_of(sources_, [](const auto& source) {
    return source->status().state == ConnectionState::ended;
  });
}

std::vector<SourceStatus> Session::sources() const {
  std::vector<SourceStatus> list;
  for (const auto& source : sources_) list.push_back(source->status());
  return list;
}

std::string Session::status() const {
  std::string text;
  const Stamp now = host_now();
  for (const SourceStatus& s : sources()) {
    if (s.state == ConnectionState::receiving) continue;
    text += fmt::format("{}{} {} since {:.0f} s", text.empty() ? "" : ", ", s.name,
                        to_string(s.state), seconds_between(s.since, now));
  }
  return text.empty() ? "all sources receiving" : text;
}

std::map<std::string, std::size_t> Session::late() const {
  const std::scoped_lock lock(mutex_);
  return merger_.late();
}

}  // namespace apvi::live
