// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>

#include "apvi/config/node.hpp"
#include "apvi/core/error.hpp"
#include "apvi/geometry/so3.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/version.hpp"

/// Uses the core, config, geometry and sensors modules of an installed apvi; exits with status 0 if
/// the results are correct.
int main() {
  try {
    const Eigen::Vector3d phi(0.1, -0.2, 0.3);
    const double round_trip = (apvi::so3::log(apvi::so3::exp(phi)) - phi).norm();
    const apvi::Rig rig = apvi::make_rig(apvi::config::parse_yaml("world: ned\n", "consumer.yaml"));
    std::printf("apvi %s (%s): round trip %.1e\n", apvi::kVersion, apvi::kBackend, round_trip);
    return round_trip < 1e-12 && rig.down_sign() == 1.0 ? 0 : 1;
  } catch (const apvi::InputError& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 2;
  }
}
