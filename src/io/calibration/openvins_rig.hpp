// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/config/node.hpp"

namespace apvi::io {

/// Whether a file is OpenVINS's estimator_config.yaml.
bool is_openvins(const config::Node& file);
/// The rig of the calibration files that it names, which lie relative to it. With `max_cameras: 1`
/// there is no cam1. The time offset of cam0 is that of cam1, as in OpenVINS. Throws InputError
/// when a file is missing or wrong.
config::Node rig_of_openvins(const config::Node& file);

}  // namespace apvi::io
