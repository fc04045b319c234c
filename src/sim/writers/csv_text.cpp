// SPDX-License-Identifier: BSD-3-Clause
#include "sim/writers/csv_text.hpp"

#include <fmt/format.h>

#include <iterator>

#include "io/folder/csv_rows.hpp"

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

template <typename Sample>
std::string rows(std::string_view header, const std::vector<Sample>& samples) {
  constexpr int kDigits = 9;
  std::string csv = begin(header);
  for (const Sample& sample : samples) csv += io::csv_row(sample, kDigits) + "\n";
  return csv;
}

}  // namespace

std::string imu_csv(const std::vector<ImuSample>& samples, std::string_view header) {
  return rows(header, samples);
}

std::string dvl_csv(const std::vector<DvlSample>& samples) {
  return rows(io::kDvlCsvHeader, samples);
}

std::string pressure_csv(const std::vector<PressureSample>& samples) {
  return rows(io::kPressureCsvHeader, samples);
}

std::string depth_csv(const std::vector<PressureDepthSample>& samples) {
  return rows(io::kDepthCsvHeader, samples);
}

std::string camera_csv(const std::vector<FrameTime>& frames, std::string_view header,
                       std::string_view extension) {
  std::string csv = begin(header);
  for (const FrameTime& frame : frames) append(csv, "{0},{0}{1}\n", frame.stamp.ns, extension);
  return csv;
}

std::string exposure_csv(const std::vector<FrameTime>& frames,
                         const std::vector<Development>& exposures, double shutter_s) {
  std::string csv = begin("#timestamp [ns],shutter [s],iso,gain_red,gain_green,gain_blue");
  for (std::size_t i = 0; i < frames.size(); ++i) {
    append(csv, "{},{:.9g},{:.6g}", frames[i].stamp.ns, shutter_s, 100.0 * exposures[i].gain);
    append_vector(csv, exposures[i].white_balance);
    csv += '\n';
  }
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
