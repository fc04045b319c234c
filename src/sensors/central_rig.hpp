// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/config/node.hpp"
#include "apvi/sensors/rig.hpp"

namespace apvi {

/// The rig.yaml `node`, of which `make_rig` made `rig`, with central cameras in place of those
/// behind a port: intrinsics, distortion, coefficients and pose change, and `port` goes.
config::Node central_rig(const config::Node& node, const Rig& rig);

}  // namespace apvi
