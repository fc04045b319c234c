// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

#include "apvi/geometry/trajectory.hpp"

namespace apvi::io {

/// What to do with lines that hold no pose, and with stamps that do not increase.
enum class BadLines { fail, drop };

/// Reads a trajectory: columns by the names of a header; without one TUM lines
/// (`t tx ty tz qx qy qz qw`, t in seconds) or EuRoC csv (`t p_xyz q_wxyz`, t in nanoseconds).
/// Units in the header are converted; stamps of the size of an epoch in ms, us or ns are
/// recognized. Stamps are exact to the nanosecond. Throws InputError with file and line for lines
/// in no such format, non-finite numbers, quaternions far from unit norm, and stamps that do not
/// increase; with BadLines::drop only when no line is good, else a warning counts them. Throws
/// InputError when stamps have lost digits.
Trajectory read_trajectory(const std::filesystem::path& path, BadLines bad_lines = BadLines::fail);

/// One TUM line, newline included, with the stamp exact to the nanosecond.
std::string tum_line(const StampedPose& pose);
/// Writes TUM lines with nanosecond stamps. Throws RunError when the file cannot be written
/// completely.
void write_tum(const std::filesystem::path& path, const Trajectory& trajectory);
/// Writes EuRoC's `state_groundtruth_estimate0` columns (position and quaternion wxyz).
void write_euroc(const std::filesystem::path& path, const Trajectory& trajectory);

/// Writes a text file completely, or throws RunError with its name ("disk full?").
void write_text_file(const std::filesystem::path& path, const std::string& content);

}  // namespace apvi::io
