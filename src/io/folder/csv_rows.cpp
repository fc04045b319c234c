// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/csv_rows.hpp"

#include <fmt/format.h>

#include <optional>

namespace apvi::io {
namespace {

std::string cell(double value, int digits) {
  return fmt::format(",{:.{}g}", value, digits);
}

std::string cell(const std::optional<double>& value, int digits) {
  return value ? cell(*value, digits) : ",";
}

std::string cells(const Eigen::Vector3d& v, int digits) {
  return cell(v.x(), digits) + cell(v.y(), digits) + cell(v.z(), digits);
}

std::string flag(bool value) {
  return value ? ",1" : ",0";
}

}  // namespace

std::string csv_row(const ImuSample& sample, int digits) {
  return std::to_string(sample.stamp.ns) + cells(sample.gyro, digits) + cells(sample.accel, digits);
}

std::string csv_row(const DvlSample& sample, int digits) {
  std::string row = std::to_string(sample.stamp.ns) + cells(sample.velocity, digits) +
                    cell(sample.figure_of_merit, digits) + cell(sample.altitude, digits) +
                    flag(sample.valid);
  for (const auto& beam : sample.beams) row += beam ? cell(beam->velocity, digits) : ",";
  for (const auto& beam : sample.beams) row += beam ? cell(beam->range, digits) : ",";
  for (const auto& beam : sample.beams) row += beam ? flag(beam->valid) : ",";
  return row;
}

std::string csv_row(const PressureSample& sample, int digits) {
  return std::to_string(sample.stamp.ns) + cell(sample.pressure_pa, digits);
}

std::string csv_row(const PressureDepthSample& sample, int digits) {
  return std::to_string(sample.stamp.ns) + cell(sample.depth_m, digits);
}

}  // namespace apvi::io
