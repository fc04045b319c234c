// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/sensors/samples.hpp"

namespace apvi::io {

/// Validity of a sample from a recording without a validity flag. Devices report exact zeros on all
/// axes and beams when they have no bottom lock.
bool infer_validity(const DvlSample& sample);

/// Removes placeholders for missing values: negative altitudes and ranges, and non-finite numbers
/// in optional fields and in the velocity of a sample or beam that is flagged invalid.
void clear_placeholder_values(DvlSample& sample);

}  // namespace apvi::io
