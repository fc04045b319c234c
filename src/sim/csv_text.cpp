// SPDX-License-Identifier: BSD-3-Clause
#include "sim/csv_text.hpp"

#include <fmt/format.h>

#include <iterator>

namespace apvi::sim {
namespace {

using Eigen::Vector3d;

template <typename... Args>
void append(std::string& csv, fmt::format_string<Args...> format, Args&&... args) {
  fmt::format_to(std::back_inserter(csv), format, std::forward<Args>(args)...);
}

std::string begin(std::string_view header) {
  return std::string(header) + "\n";
}

void append_vector(std::string& csv, const Vector3d& v) {
  append(csv, ",{:.9g},{:.9g},{:.9g}", v.x(), v.y(), v.z());
}

std::string cell(const std::optional<double>& value) {
  return value ? fmt::format("{:.9g}", *value) : "";
}

}  // namespace

std::string imu_csv(const std::vector<ImuSample>& samples, std::string_view header) {
  std::string csv = begin(header);
  for (const ImuSample& sample : samples) {
    append(csv, "{}", sample.stamp.ns);
    append_vector(csv, sample.gyro);
    append_vector(csv, sample.accel);
    csv += '\n';
  }
  return csv;
}

std::string dvl_csv(const std::vector<DvlSample>& samples) {
  std::string csv =
      "#timestamp [ns],v_x [m s^-1],v_y [m s^-1],v_z [m s^-1],figure_of_merit [m s^-1],altitude "
      "[m],"
      "valid [0|1],beam0_v [m s^-1],beam1_v [m s^-1],beam2_v [m s^-1],beam3_v [m s^-1],"
      "beam0_range [m],beam1_range [m],beam2_range [m],beam3_range [m],beam0_valid,beam1_valid,"
      "beam2_valid,beam3_valid\n";
  for (const DvlSample& sample : samples) {
    append(csv, "{}", sample.stamp.ns);
    append_vector(csv, sample.velocity);
    append(csv, ",{},{},{}", cell(sample.figure_of_merit), cell(sample.altitude),
           sample.valid ? 1 : 0);
    for (const auto& beam : sample.beams) append(csv, ",{:.9g}", beam->velocity);
    for (const auto& beam : sample.beams) append(csv, ",{}", cell(beam->range));
    for (const auto& beam : sample.beams) append(csv, ",{}", beam->valid ? 1 : 0);
    csv += '\n';
  }
  return csv;
}

std::string pressure_csv(const std::vector<PressureSample>& samples) {
  std::string csv = "#timestamp [ns],pressure [Pa]\n";
  for (const auto& sample : samples)
    append(csv, "{},{:.9g}\n", sample.stamp.ns, sample.pressure_pa);
  return csv;
}

std::string depth_csv(const std::vector<PressureDepthSample>& samples) {
  std::string csv = "#timestamp [ns],depth [m]\n";
  for (const auto& sample : samples) append(csv, "{},{:.9g}\n", sample.stamp.ns, sample.depth_m);
  return csv;
}

std::string camera_csv(const std::vector<FrameTime>& frames, std::string_view header) {
  std::string csv = begin(header);
  for (const FrameTime& frame : frames) append(csv, "{0},{0}.png\n", frame.stamp.ns);
  return csv;
}

std::string truth_csv(const ImuRecord& record, std::string_view header) {
  std::string csv = begin(header);
  for (std::size_t i = 0; i < record.samples.size(); ++i) {
    const Motion& motion = record.truth[i];
    const Vector3d& p = motion.T_world_body.translation;
    const Eigen::Quaterniond& q = motion.T_world_body.rotation;
    append(csv, "{},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f}", record.samples[i].stamp.ns,
           p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z());
    append_vector(csv, motion.velocity_world);
    append_vector(csv, record.gyro_bias[i]);
    append_vector(csv, record.accel_bias[i]);
    csv += '\n';
  }
  return csv;
}

}  // namespace apvi::sim
