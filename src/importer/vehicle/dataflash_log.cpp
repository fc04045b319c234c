// SPDX-License-Identifier: BSD-3-Clause
#include "importer/vehicle/dataflash_log.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <map>

#include "apvi/core/log.hpp"
#include "importer/vehicle/dataflash.hpp"
#include "importer/vehicle/parameters.hpp"

namespace apvi::importer {
namespace {

using Eigen::Vector3d;

struct TimedVector {
  Stamp stamp;
  Vector3d value;
};

std::optional<std::int64_t> whole_number_in(const DataflashMessage& message, const char* field,
                                            std::int64_t max) {
  const auto number = message.number(field);
  if (!number || !(*number >= 0.0 && *number <= static_cast<double>(max))) return std::nullopt;
  return static_cast<std::int64_t>(*number);
}

std::optional<Stamp> stamp_in(const DataflashMessage& message, const char* field) {
  constexpr std::int64_t kYear_us = 31'536'000'000'000;  // nothing runs longer
  const auto us = whole_number_in(message, field, kYear_us);
  return us && *us > 0 ? std::optional(Stamp{1000 * *us}) : std::nullopt;
}

std::optional<Vector3d> vector_in(const DataflashMessage& message, const char* x, const char* y,
                                  const char* z) {
  const auto a = message.number(x);
  const auto b = message.number(y);
  const auto c = message.number(z);
  if (!a || !b || !c) return std::nullopt;
  const Vector3d vector(*a, *b, *c);
  return vector.allFinite() ? std::optional(vector) : std::nullopt;
}

// Old logs number instances by name: IMU, IMU2, IMU3; ACC1, ACC2, ACC3; BARO, BAR2, BAR3.
int instance_of(const DataflashMessage& message) {
  constexpr std::int64_t kMaxInstance = 255;
  if (const auto instance = whole_number_in(message, "I", kMaxInstance)) {
    return static_cast<int>(*instance);
  }
  const char last = message.name().back();
  return last >= '1' && last <= '9' ? last - '1' : 0;
}

// The samples of the instance with the lowest number.
template <typename Sample>
class LowestInstance {
 public:
  void add(int instance, const Sample& sample) {
    if (instance > instance_) return;
    if (instance < instance_) samples_.clear();
    instance_ = instance;
    samples_.push_back(sample);
  }
  std::vector<Sample>& samples() { return samples_; }

 private:
  int instance_ = std::numeric_limits<int>::max();
  std::vector<Sample> samples_;
};

// Accelerations interpolated at the times of the angular rates, which may be faster.
std::vector<ImuSample> join(const std::vector<TimedVector>& rates,
                            const std::vector<TimedVector>& forces) {
  std::vector<ImuSample> imu;
  std::size_t next = 0;
  for (const TimedVector& rate : rates) {
    while (next < forces.size() && forces[next].stamp < rate.stamp) ++next;
    if (next == forces.size()) break;
    const TimedVector& after = forces[next];
    if (next == 0 && after.stamp > rate.stamp) continue;
    const TimedVector& before = forces[next == 0 ? 0 : next - 1];
    const double gap = seconds_between(before.stamp, after.stamp);
    const double weight = gap > 0.0 ? seconds_between(before.stamp, rate.stamp) / gap : 1.0;
    imu.push_back({rate.stamp, rate.value, before.value + weight * (after.value - before.value)});
  }
  return imu;
}

class DataflashLog {
 public:
  void take(const DataflashMessage& message) {
    const std::string& name = message.name();
    if (name == "PARM") return take_parameter(message);
    const auto stamp = stamp_in(message, "TimeUS");
    if (!stamp) return;
    if (name.starts_with("IMU")) take_imu(message, *stamp);
    if (name.starts_with("GYR")) take_raw(message, *stamp, {"GyrX", "GyrY", "GyrZ"}, rates_);
    if (name.starts_with("ACC")) take_raw(message, *stamp, {"AccX", "AccY", "AccZ"}, forces_);
    if (name.starts_with("BAR")) take_pressure(message, *stamp);
    if (name == "VISO") take_dvl(message, *stamp);
    if (name == "GPS") take_gps(message, *stamp);
  }

  SensorData finish(const std::string& name) {
    SensorData data;
    data.is_forward_right_down = true;
    data.imu = std::move(imu_.samples());
    const auto by_stamp = [](const TimedVector& v) { return v.stamp; };
    std::ranges::stable_sort(rates_.samples(), {}, by_stamp);
    std::ranges::stable_sort(forces_.samples(), {}, by_stamp);
    std::vector<ImuSample> raw = join(rates_.samples(), forces_.samples());
    if (raw.size() > data.imu.size()) data.imu = std::move(raw);
    const int barometer = choose_barometer(name);
    data.pressure = std::move(pressure_[barometer]);
    data.dvl = std::move(dvl_);
    data.gnss = std::move(gnss_);
    parameters_.apply(barometer, data);
    if (unix_minus_boot_) shift(data);
    data.put_in_order();
    return data;
  }

 private:
  void take_parameter(const DataflashMessage& message) {
    if (const auto value = message.number("Value")) parameters_.set(message.text("Name"), *value);
  }

  void take_imu(const DataflashMessage& message, Stamp stamp) {
    const auto gyro = vector_in(message, "GyrX", "GyrY", "GyrZ");
    const auto accel = vector_in(message, "AccX", "AccY", "AccZ");
    if (gyro && accel) imu_.add(instance_of(message), {stamp, *gyro, *accel});
  }

  void take_raw(const DataflashMessage& message, Stamp logged,
                const std::array<const char*, 3>& axes, LowestInstance<TimedVector>& samples) {
    const Stamp stamp = stamp_in(message, "SampleUS").value_or(logged);
    const auto value = vector_in(message, axes[0], axes[1], axes[2]);
    if (value) samples.add(instance_of(message), {stamp, *value});
  }

  void take_pressure(const DataflashMessage& message, Stamp stamp) {
    const auto pressure = message.number("Press");
    if (pressure && *pressure > 0.0) pressure_[instance_of(message)].push_back({stamp, *pressure});
  }

  void take_dvl(const DataflashMessage& message, Stamp stamp) {
    const auto motion = vector_in(message, "PosDX", "PosDY", "PosDZ");
    const auto sample =
        dvl_of_delta(stamp, motion.value_or(Vector3d::Zero()), message.number("dt").value_or(0.0),
                     message.number("conf").value_or(0.0));
    if (motion && sample) dvl_.push_back(*sample);
  }

  void take_gps(const DataflashMessage& message, Stamp stamp) {
    constexpr double kFix3d = 3.0;
    if (message.number("Status").value_or(0.0) < kFix3d) return;
    note_time(message, stamp);
    const auto position = vector_in(message, "Lat", "Lng", "Alt");
    if (!position) return;
    const io::GeodeticPosition fix{position->x(), position->y(), position->z()};
    if (io::is_fix(fix)) gnss_.push_back({stamp, fix});
  }

  // Messages are logged late, never early: the largest difference is that of the least delay.
  void note_time(const DataflashMessage& message, Stamp stamp) {
    constexpr std::int64_t kGpsEpoch_s = 315'964'800;
    constexpr std::int64_t kLeapSeconds = 18;  // since 2017
    constexpr std::int64_t kWeek_s = 604'800;
    constexpr std::int64_t kMaxWeek = 6000;
    const auto week = whole_number_in(message, "GWk", kMaxWeek);
    const auto ms = whole_number_in(message, "GMS", 1000 * kWeek_s);
    if (!week || *week == 0 || !ms) return;
    const std::int64_t seconds = kGpsEpoch_s + kWeek_s * *week - kLeapSeconds;
    const Duration difference = Stamp{1'000'000'000 * seconds + 1'000'000 * *ms} - stamp;
    unix_minus_boot_ = std::max(unix_minus_boot_.value_or(difference), difference);
  }

  // The barometer in the water is the second one; the first is inside the housing.
  int choose_barometer(const std::string& name) {
    for (const int instance : {1, 2}) {
      if (pressure_.contains(instance)) return instance;
    }
    if (pressure_.contains(0)) warn_of_internal_pressure(name);
    return 0;
  }

  void shift(SensorData& data) const {
    const auto add = [this](auto& samples) {
      for (auto& sample : samples) sample.stamp = sample.stamp + *unix_minus_boot_;
    };
    add(data.imu);
    add(data.dvl);
    add(data.pressure);
    add(data.gnss);
  }

  LowestInstance<ImuSample> imu_;
  LowestInstance<TimedVector> rates_;
  LowestInstance<TimedVector> forces_;
  std::map<int, std::vector<PressureSample>> pressure_;
  std::vector<DvlSample> dvl_;
  std::vector<GnssFix> gnss_;
  std::optional<Duration> unix_minus_boot_;
  VehicleParameters parameters_;
};

}  // namespace

SensorData read_dataflash_log(std::istream& in, const std::string& name) {
  DataflashLog log;
  const std::size_t skipped =
      for_each_dataflash_message(in, [&](const DataflashMessage& m) { log.take(m); });
  if (skipped > 0) log::warning("{}: {} bytes without a message; skipped", name, skipped);
  return log.finish(name);
}

}  // namespace apvi::importer
