// SPDX-License-Identifier: BSD-3-Clause
#include "live/mavlink_link.hpp"

#include <algorithm>
#include <array>
#include <utility>
#include <variant>

#include "apvi/core/log.hpp"
#include "live/host_clock.hpp"

namespace apvi::live {
namespace {

using mavlink::Id;

constexpr Duration kAskPeriod{1'000'000'000};

ClockReading reading_of(const mavlink::Time& time, Stamp arrival) {
  return {.sent = time.stamp, .arrival = arrival, .clock = static_cast<std::size_t>(time.clock)};
}

}  // namespace

MessageChoice::MessageChoice(std::vector<Id> best_first, std::optional<Id> given)
    : candidates_(given ? std::vector<Id>{*given} : std::move(best_first)) {}

bool MessageChoice::accepts(Id id) {
  const auto found = std::ranges::find(candidates_, id);
  changed_ = found != candidates_.end() && (!chosen_ || *chosen_ != id);
  if (found == candidates_.end()) return false;
  chosen_ = id;
  candidates_.erase(found + 1, candidates_.end());
  return true;
}

MavlinkLink::MavlinkLink(MavlinkOptions options)
    : options_(std::move(options)),
      socket_(options_.listen ? Socket::bind_udp(options_.address)
                              : Socket::connect_udp(options_.address)),
      imu_(mavlink::imu_messages(), options_.imu),
      pressure_(mavlink::pressure_messages(), options_.pressure) {}

bool MavlinkLink::receive(Receiver& receiver) {
  ask(host_now());
  if (!socket_.wait(kPollPeriod)) return true;
  std::array<std::uint8_t, 65536> bytes{};
  const std::size_t size = socket_.read(bytes);
  const Stamp arrival = host_now();
  const std::size_t damaged =
      mavlink::decode(std::span(bytes).first(size),
                      [&](const mavlink::Frame& frame) { take(frame, arrival, receiver); });
  for (std::size_t i = 0; i < damaged; ++i) receiver.malformed("MAVLink checksum");
  return true;
}

void MavlinkLink::ask(Stamp now) {
  if (now - asked_ < kAskPeriod) return;
  asked_ = now;
  send(mavlink::heartbeat());
  send(mavlink::time_request(now));
}

void MavlinkLink::send(const mavlink::Frame& frame) {
  socket_.answer(mavlink::encode(frame, sequence_++));
}

// Ground stations and other vehicles may share the port.
bool MavlinkLink::is_from_vehicle(const mavlink::Frame& frame, const mavlink::Message& message) {
  const bool has_data = std::holds_alternative<mavlink::Imu>(message) ||
                        std::holds_alternative<mavlink::Pressure>(message);
  if (has_data && !system_) system_ = frame.system;
  return system_ == frame.system;
}

void MavlinkLink::take(const mavlink::Frame& frame, Stamp arrival, Receiver& receiver) {
  const auto message = mavlink::interpret(frame);
  if (!message || !is_from_vehicle(frame, *message)) return;
  std::visit([&](const auto& m) { take(m, arrival, receiver); }, *message);
}

void MavlinkLink::take(const mavlink::Imu& imu, Stamp arrival, Receiver& receiver) {
  if (!imu_.accepts(imu.id)) return receiver.clock(reading_of(imu.time, arrival));
  if (imu_.changed()) log::info("{}: inertial data: {}", options_.name, name_of(imu.id));
  receiver.sample(ImuSample{imu.time.stamp, imu.gyro, imu.accel}, reading_of(imu.time, arrival));
}

void MavlinkLink::take(const mavlink::Pressure& pressure, Stamp arrival, Receiver& receiver) {
  if (!pressure_.accepts(pressure.id)) return;
  if (pressure_.changed()) log::info("{}: pressure: {}", options_.name, name_of(pressure.id));
  receiver.sample(PressureSample{pressure.time.stamp, pressure.pressure_pa},
                  reading_of(pressure.time, arrival));
}

void MavlinkLink::take(const mavlink::SystemTime& time, Stamp arrival, Receiver& receiver) {
  receiver.clock(reading_of({time.boot, mavlink::Clock::boot}, arrival));
  if (time.unix_time) receiver.clock(reading_of({*time.unix_time, mavlink::Clock::unix}, arrival));
}

void MavlinkLink::take(const mavlink::TimeSync& sync, Stamp arrival, Receiver& receiver) {
  if (sync.remote.ns == 0 || sync.local != asked_) return;  // a request, or another one's answer
  const Duration round_trip = arrival - sync.local;
  constexpr std::int64_t kUnix2001_ns = 1'000'000'000'000'000'000;
  const auto clock = sync.remote.ns >= kUnix2001_ns ? mavlink::Clock::unix : mavlink::Clock::boot;
  receiver.clock(reading_of({sync.remote, clock}, sync.local + Duration{round_trip.ns / 2}));
}

}  // namespace apvi::live
