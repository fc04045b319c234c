// SPDX-License-Identifier: BSD-3-Clause
#include "live/source.hpp"

#include <algorithm>
#include <utility>
#include <variant>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "live/host_clock.hpp"

namespace apvi::live {

std::string_view to_string(ConnectionState state) {
  switch (state) {
    case ConnectionState::connecting:
      return "connecting";
    case ConnectionState::receiving:
      return "receiving";
    case ConnectionState::lost:
      return "lost";
    case ConnectionState::ended:
      return "ended";
  }
  return "";
}

void Source::start(Sink sink) {
  sink_ = std::move(sink);
  retry_s_ = options_.first_retry_s;
  {
    const std::scoped_lock lock(mutex_);
    status_.name = options_.name;
    status_.since = host_now();
  }
  thread_ = std::jthread([this](std::stop_token stop) { run(std::move(stop)); });
}

void Source::stop() {
  thread_.request_stop();
  if (thread_.joinable()) thread_.join();
}

SourceStatus Source::status() const {
  const std::scoped_lock lock(mutex_);
  return status_;
}

void Source::run(std::stop_token stop) {
  while (!stop.stop_requested()) {
    try {
      if (!use_link(stop)) return enter(ConnectionState::ended);
    } catch (const std::exception& e) {
      if (stop.stop_requested()) return;
      lost(e.what());
      if (!wait(stop, retry_s_)) return;
      retry_s_ = std::min(2.0 * retry_s_, options_.last_retry_s);
    }
  }
}

// False at the end of the data.
bool Source::use_link(std::stop_token stop) {
  const std::unique_ptr<Link> link = open_(stop);
  last_sample_ = host_now();
  while (!stop.stop_requested()) {
    if (!link->receive(*this)) return false;
    check_silence();
  }
  return true;
}

void Source::check_silence() {
  const double silent_s = seconds_between(last_sample_, host_now());
  if (silent_s < options_.silence_s) return;
  const std::string reason = fmt::format("no samples for {:.0f} s", silent_s);
  if (options_.reopen_when_silent) fail_run("{}", reason);
  if (status().state != ConnectionState::lost) lost(reason);
}

void Source::lost(const std::string& reason) {
  // Once: the attempts that follow fail alike.
  if (status().state != ConnectionState::lost) {
    log::warning("{}: {}; trying again", options_.name, reason);
  } else {
    log::debug("{}: {}; trying again", options_.name, reason);
  }
  enter(ConnectionState::lost);
}

void Source::enter(ConnectionState state) {
  const std::scoped_lock lock(mutex_);
  if (status_.state == state) return;
  if (state == ConnectionState::lost) ++status_.losses;
  status_.state = state;
  status_.since = host_now();
}

bool Source::wait(std::stop_token stop, double seconds) {
  std::unique_lock lock(mutex_);
  stopped_.wait_for(lock, stop, std::chrono::duration<double>(seconds), [] { return false; });
  return !stop.stop_requested();
}

void Source::clock(const ClockReading& reading) {
  ClockAligner& aligner = clocks_[reading.clock];
  const std::size_t steps = aligner.steps();
  aligner.add(reading.sent, reading.arrival);
  if (aligner.steps() == steps) return;
  log::warning("{}: its clock jumped by {:+.3f} s; stamps follow it", options_.name,
               aligner.last_step().seconds());
  const std::scoped_lock lock(mutex_);
  ++status_.clock_steps;
}

void Source::sample(SensorEvent event, const ClockReading& reading) {
  clock(reading);
  last_sample_ = reading.arrival;
  retry_s_ = options_.first_retry_s;
  const SourceStatus before = status();
  if (before.state != ConnectionState::receiving) {
    const double lost_s = seconds_between(before.since, reading.arrival);
    const bool again = before.state == ConnectionState::lost;
    log::info("{}: receiving{}", options_.name,
              again ? fmt::format(" again after {:.1f} s", lost_s) : "");
    enter(ConnectionState::receiving);
  }
  const ClockAligner& aligner = clocks_[reading.clock];
  {
    const std::scoped_lock lock(mutex_);
    ++(aligner.ready() ? status_.samples : status_.warm_up);
  }
  if (!aligner.ready()) return;
  std::visit([&](auto& sample) { sample.stamp = aligner.to_host(sample.stamp); }, event);
  sink_(std::move(event), reading.arrival);
}

void Source::malformed(std::string_view reason) {
  std::size_t count = 0;
  {
    const std::scoped_lock lock(mutex_);
    count = ++status_.malformed;
  }
  if (count == 1) log::warning("{}: malformed data: {}", options_.name, reason);
}

}  // namespace apvi::live
