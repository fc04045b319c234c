// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <cstdio>

#include "apvi/config/node.hpp"
#include "apvi/core/error.hpp"
#include "apvi/geometry/so3.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/sound_speed.hpp"
#include "apvi/version.hpp"

/// Uses the core, config, geometry and sensors modules of an installed apvi; status 0 when their
/// answers are right.
int main() {
  try {
    const Eigen::Vector3d phi(0.1, -0.2, 0.3);
    const double round_trip = (apvi::so3::log(apvi::so3::exp(phi)) - phi).norm();
    const apvi::Rig rig = apvi::make_rig(apvi::config::parse_yaml("world: ned\n", "consumer.yaml"));
    const double c = apvi::sound_speed(10.0, 35.0, 0.0);
    std::printf("apvi %s (%s): round trip %.1e, sound %.1f m/s\n", apvi::kVersion, apvi::kBackend,
                round_trip, c);
    return round_trip < 1e-12 && std::abs(c - 1489.8) < 0.1 && rig.depth_sign() == 1.0 ? 0 : 1;
  } catch (const apvi::InputError& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 2;
  }
}
