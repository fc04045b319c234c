// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>

#include "apvi/sensors/samples.hpp"

/// The sensor files of a dataset folder as text: a header line, and a line for each sample, without
/// line breaks.
namespace apvi::io {

/// Significant digits with which a double is read back exactly.
inline constexpr int kExactDigits = 17;

inline constexpr std::string_view kImuCsvHeader =
    "#timestamp [ns],w_x [rad s^-1],w_y [rad s^-1],w_z [rad s^-1],a_x [m s^-2],a_y [m s^-2],"
    "a_z [m s^-2]";
inline constexpr std::string_view kDvlCsvHeader =
    "#timestamp [ns],v_x [m s^-1],v_y [m s^-1],v_z [m s^-1],figure_of_merit [m s^-1],altitude [m],"
    "valid [0|1],beam0_v [m s^-1],beam1_v [m s^-1],beam2_v [m s^-1],beam3_v [m s^-1],"
    "beam0_range [m],beam1_range [m],beam2_range [m],beam3_range [m],beam0_valid,beam1_valid,"
    "beam2_valid,beam3_valid";
inline constexpr std::string_view kPressureCsvHeader = "#timestamp [ns],pressure [Pa]";
inline constexpr std::string_view kDepthCsvHeader = "#timestamp [ns],depth [m]";
inline constexpr std::string_view kImageCsvHeader = "#timestamp [ns],filename";

std::string csv_row(const ImuSample& sample, int digits);
/// The cells of a beam that was not reported are empty.
std::string csv_row(const DvlSample& sample, int digits);
std::string csv_row(const PressureSample& sample, int digits);
std::string csv_row(const PressureDepthSample& sample, int digits);

}  // namespace apvi::io
