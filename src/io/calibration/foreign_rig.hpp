// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

#include "apvi/config/node.hpp"

namespace apvi::io {

/// Converts a file of another tool to nodes of a rig.yaml. False, without a change, when the file
/// is not recognized. Poses that need another file are left to `finish_foreign`.
bool convert_foreign(config::Node& file);

/// Completes a rig of converted files: poses against the body. Logs once what is assumed for want
/// of an entry. Throws InputError for a camera without intrinsics or resolution, and for a second
/// camera without a pose. `name` is that of the file in messages.
void finish_foreign(config::Node& rig, const std::string& name);

/// The rig of the sensor.yaml files below EuRoC's folder `mav0`; null when there are none.
config::Node load_euroc_rig(const std::filesystem::path& mav);

}  // namespace apvi::io
