// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/io/tum.hpp"

#include <fmt/format.h>

#include <cerrno>
#include <fstream>
#include <iterator>
#include <system_error>

#include "apvi/core/error.hpp"
#include "io/folder/csv_file.hpp"
#include "io/trajectory/trajectory_text.hpp"

namespace apvi::io {
namespace {

// Seconds with nine decimals, exact.
std::string seconds_text(Stamp stamp) {
  const auto magnitude = stamp.ns < 0 ? 0 - static_cast<std::uint64_t>(stamp.ns)
                                      : static_cast<std::uint64_t>(stamp.ns);
  return fmt::format("{}{}.{:09}", stamp.ns < 0 ? "-" : "", magnitude / 1'000'000'000,
                     magnitude % 1'000'000'000);
}

}  // namespace

Trajectory read_trajectory(const std::filesystem::path& path, BadLines bad_lines) {
  Trajectory trajectory = parse_trajectory(*open_text(path), path.string(), bad_lines);
  if (trajectory.empty()) fail_input("{}: no poses in this file", path.string());
  return trajectory;
}

std::string tum_line(const StampedPose& pose) {
  const auto& p = pose.T_world_body.translation;
  const auto& q = pose.T_world_body.rotation;
  return fmt::format("{} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f}\n",
                     seconds_text(pose.stamp), p.x(), p.y(), p.z(), q.x(), q.y(), q.z(), q.w());
}

void write_tum(const std::filesystem::path& path, const Trajectory& trajectory) {
  std::string content;
  for (const StampedPose& pose : trajectory.poses) content += tum_line(pose);
  write_text_file(path, content);
}

void write_euroc(const std::filesystem::path& path, const Trajectory& trajectory) {
  std::string content = "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w,q_x,q_y,q_z\n";
  for (const StampedPose& pose : trajectory.poses) {
    const auto& p = pose.T_world_body.translation;
    const auto& q = pose.T_world_body.rotation;
    fmt::format_to(std::back_inserter(content),
                   "{},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f},{:.9f}\n", pose.stamp.ns, p.x(),
                   p.y(), p.z(), q.w(), q.x(), q.y(), q.z());
  }
  write_text_file(path, content);
}

void write_text_file(const std::filesystem::path& path, const std::string& content) {
  errno = 0;
  std::ofstream out(path, std::ios::binary);
  out.write(content.data(), static_cast<std::streamsize>(content.size()));
  out.close();  // a full disk may be reported only here
  if (out) return;
  const std::string reason = errno != 0 ? std::generic_category().message(errno) : "disk full?";
  fail_run("{}: cannot write this file: {}", path.string(), reason);
}

}  // namespace apvi::io
