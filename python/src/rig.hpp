// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/config/node.hpp"
#include "apvi/sensors/rig.hpp"

namespace apvi::python {

/// A calibration with the nodes that it was read from.
struct RigFile {
  explicit RigFile(config::Node given) : node(std::move(given)), rig(make_rig(node)) {}

  config::Node node;
  Rig rig;
};

}  // namespace apvi::python
