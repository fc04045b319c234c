// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/sensors/samples.hpp"

namespace apvi::io {

/// For recordings without a validity flag: whether the sample is a measurement. Devices fill in
/// zeros when they have no bottom lock; nothing moves at exactly zero on all axes and all beams.
bool looks_valid(const DvlSample& sample);

/// Removes what a device writes for "no value": negative altitudes and ranges, numbers that are not
/// finite in optional fields, and in the velocity of a sample or beam that says it is invalid.
void tidy(DvlSample& sample);

}  // namespace apvi::io
