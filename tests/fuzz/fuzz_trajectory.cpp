// SPDX-License-Identifier: BSD-3-Clause
#include <sstream>

#include "apvi/core/error.hpp"
#include "fuzz/fuzz_target.hpp"
#include "io/trajectory/trajectory_text.hpp"

// Trajectory files: TUM, EuRoC, GNSS.

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace apvi;
  std::istringstream in(std::string(reinterpret_cast<const char*>(data), size));
  try {
    const Trajectory trajectory = io::parse_trajectory(in, "fuzz.tum");
    for (std::size_t i = 0; i < trajectory.size(); ++i) {
      const auto& pose = trajectory.poses[i];
      fuzz::check(pose.T_world_body.translation.allFinite(), "a position is not finite");
      fuzz::check(std::abs(pose.T_world_body.rotation.norm() - 1.0) < 1e-9,
                  "a rotation is not normalized");
      fuzz::check(i == 0 || trajectory.poses[i - 1].stamp < pose.stamp, "stamps do not increase");
    }
  } catch (const InputError&) {
  }
  return 0;
}
