// SPDX-License-Identifier: BSD-3-Clause
#include "importer/vehicle/mavlink_log.hpp"

#include <deque>
#include <map>
#include <tuple>

#include "apvi/core/log.hpp"
#include "importer/vehicle/byte_window.hpp"
#include "importer/vehicle/log_clock.hpp"
#include "importer/vehicle/parameters.hpp"
#include "io/mavlink/messages.hpp"

namespace apvi::importer {
namespace {

namespace mavlink = io::mavlink;
using mavlink::Id;

constexpr std::size_t kStampSize = 8;

// A sample stamped by the clock of its sender, if it has one.
template <typename Sample>
struct Sent {
  Sample sample;
  const LogClock* clock = nullptr;
};

class MavlinkLog {
 public:
  void take(const mavlink::Frame& frame, Stamp arrival) {
    const auto message = mavlink::interpret(frame);
    if (!message) return;
    frame_ = &frame;
    arrival_ = arrival;
    std::visit([this](const auto& m) { take(m); }, *message);
  }

  SensorData finish(const std::string& name) {
    for (LogClock& clock : clocks_) clock.fit();
    SensorData data;
    data.is_forward_right_down = true;
    for (const Id id : mavlink::imu_messages()) {
      if (data.imu.empty()) data.imu = stamped(imu_[id]);
    }
    data.pressure = choose_pressure(name);
    data.dvl = stamped(dvl_);
    data.gnss = stamped(gnss_);
    parameters_.apply(pressure_instance_, data);
    data.put_in_order();
    return data;
  }

 private:
  template <typename Other>
  void take(const Other&) {}  // nothing that a data set has

  void take(const mavlink::Imu& m) {
    if (is_from_vehicle(true)) add(imu_[m.id], ImuSample{m.time.stamp, m.gyro, m.accel}, m.time);
  }
  void take(const mavlink::Pressure& m) {
    if (!is_from_vehicle(true)) return;
    add(pressure_[m.id], PressureSample{m.time.stamp, m.pressure_pa}, m.time);
  }
  void take(const mavlink::SystemTime& m) {
    if (is_from_vehicle(false)) clock_of({m.boot, mavlink::Clock::boot});
  }
  void take(const mavlink::Gps& m) {
    const io::GeodeticPosition position{m.latitude_deg, m.longitude_deg, m.altitude_m};
    if (!is_from_vehicle(false) || !m.has_fix || !io::is_fix(position)) return;
    add(gnss_, GnssFix{m.time.stamp, position}, m.time);
  }
  // A computer on board sends these, not the autopilot.
  void take(const mavlink::PositionDelta& m) {
    const auto sample =
        dvl_of_delta(m.time ? m.time->stamp : arrival_, m.position, m.duration_s, m.confidence);
    if (!sample) return;
    if (m.time) {
      add(dvl_, *sample, *m.time);
    } else {
      dvl_.push_back({*sample});
    }
  }
  void take(const mavlink::Parameter& m) {
    if (is_from_vehicle(false)) parameters_.set(m.name, m.value);
  }

  // The vehicle is the sender of the first sensor data; a log may have several senders.
  bool is_from_vehicle(bool has_data) {
    const std::pair sender(frame_->system, frame_->component);
    if (has_data && !vehicle_) vehicle_ = sender;
    return vehicle_ == sender;
  }

  const LogClock* clock_of(const mavlink::Time& time) {
    LogClock*& clock = newest_[{frame_->system, frame_->component, time.clock}];
    if (clock == nullptr || clock->is_restart(time.stamp)) clock = &clocks_.emplace_back();
    clock->add(time.stamp, arrival_);
    return clock;
  }

  template <typename Sample>
  void add(std::vector<Sent<Sample>>& samples, const Sample& sample, const mavlink::Time& time) {
    samples.push_back({sample, clock_of(time)});
  }

  template <typename Sample>
  static std::vector<Sample> stamped(const std::vector<Sent<Sample>>& sent) {
    std::vector<Sample> samples;
    for (const Sent<Sample>& s : sent) {
      samples.push_back(s.sample);
      if (s.clock != nullptr) samples.back().stamp = s.clock->to_arrival(s.sample.stamp);
    }
    return samples;
  }

  std::vector<PressureSample> choose_pressure(const std::string& name) {
    for (const Id id : mavlink::pressure_messages()) {
      if (pressure_[id].empty()) continue;
      pressure_instance_ = id == Id::scaled_pressure ? 0 : id == Id::scaled_pressure2 ? 1 : 2;
      if (pressure_instance_ == 0) warn_of_internal_pressure(name);
      return stamped(pressure_[id]);
    }
    return {};
  }

  const mavlink::Frame* frame_ = nullptr;  // the current one
  Stamp arrival_;                          // of it
  std::optional<std::pair<std::uint8_t, std::uint8_t>> vehicle_;
  std::deque<LogClock> clocks_;
  std::map<std::tuple<std::uint8_t, std::uint8_t, mavlink::Clock>, LogClock*> newest_;
  std::map<Id, std::vector<Sent<ImuSample>>> imu_;
  std::map<Id, std::vector<Sent<PressureSample>>> pressure_;
  std::vector<Sent<DvlSample>> dvl_;
  std::vector<Sent<GnssFix>> gnss_;
  int pressure_instance_ = 0;
  VehicleParameters parameters_;
};

std::optional<Stamp> stamp_at(Bytes bytes) {
  constexpr std::uint64_t kMax_us = 4'500'000'000'000'000;
  const std::uint64_t us = ByteReader(bytes).u64();
  if (us == 0 || us > kMax_us) return std::nullopt;
  return Stamp{static_cast<std::int64_t>(us) * 1000};
}

// Whether a stamp and a frame follow, or the log ends there.
bool ends_well(Bytes after) {
  if (after.empty()) return true;
  return after.size() > kStampSize && stamp_at(after) && mavlink::is_magic(after[kStampSize]);
}

}  // namespace

SensorData read_mavlink_log(std::istream& in, const std::string& name) {
  using Kind = mavlink::FrameStart::Kind;
  ByteWindow window(in);
  MavlinkLog messages;
  std::size_t damaged = 0;
  std::size_t skipped = 0;  // bytes
  while (true) {
    const Bytes bytes = window.ahead(2 * kStampSize + mavlink::kMaxFrame + 1);
    if (bytes.size() <= kStampSize) break;
    const auto stamp = stamp_at(bytes);
    const mavlink::FrameStart start =
        stamp ? mavlink::frame_at(bytes.subspan(kStampSize)) : mavlink::FrameStart{};
    const std::size_t size = kStampSize + start.size;
    const bool is_whole =
        start.kind == Kind::intact || (start.kind != Kind::none && ends_well(bytes.subspan(size)));
    if (start.kind == Kind::intact) messages.take(start.frame, *stamp);
    if (start.kind == Kind::damaged && is_whole) ++damaged;
    skipped += is_whole ? 0 : 1;
    window.skip(is_whole ? size : 1);
  }
  if (damaged + skipped > 0) {
    log::warning("{}: {} damaged messages, {} bytes without a message; skipped", name, damaged,
                 skipped);
  }
  return messages.finish(name);
}

}  // namespace apvi::importer
