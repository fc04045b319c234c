// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "apvi/core/stamp.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::io {

/// What the device answers to `get_config`; a value that it does not report is empty.
struct WaterLinkedSettings {
  std::optional<double> speed_of_sound_m_s;
  std::optional<double> mounting_rotation_deg;
};

/// A line of Water Linked's JSON protocol. At most one of `sample`, `settings` and `problem` is
/// set; none in reports of other kinds and in lines without content.
struct WaterLinkedReport {
  std::optional<DvlSample> sample;  ///< stamp: `time_of_validity`
  std::optional<Stamp> sent;        ///< of a sample: `time_of_transmission`
  bool water_track = false;         ///< the sample's velocity is against the water, and invalid
  std::optional<WaterLinkedSettings> settings;
  std::string problem;  ///< why the line is malformed
};

/// Reads a line; text around the report is skipped. Never throws on bad input.
WaterLinkedReport parse_waterlinked(std::string_view line);

}  // namespace apvi::io
