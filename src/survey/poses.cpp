// SPDX-License-Identifier: BSD-3-Clause
#include "survey/poses.hpp"

#include <fmt/format.h>

#include <ostream>

#include "core/atomic_file.hpp"

namespace apvi::survey {

void write_poses(const std::filesystem::path& file, const std::vector<StampedPose>& T_crs_camera) {
  write_file_atomically(file, [&](std::ostream& out) {
    out << "stamp_ns,easting_m,northing_m,height_m,qw,qx,qy,qz\n";
    for (const auto& [stamp, pose] : T_crs_camera) {
      const Eigen::Vector3d& p = pose.translation;
      const Eigen::Quaterniond& q = pose.rotation;
      out << fmt::format("{},{:.4f},{:.4f},{:.4f},{:.9f},{:.9f},{:.9f},{:.9f}\n", stamp.ns, p.x(),
                         p.y(), p.z(), q.w(), q.x(), q.y(), q.z());
    }
  });
}

}  // namespace apvi::survey
