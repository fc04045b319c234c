// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/sensors/samples.hpp"

namespace apvi::io {

/// Validity of a sample from a recording without a validity flag. Devices report exact zeros on all
/// axes and beams when they have no bottom lock.
bool infer_validity(const DvlSample& sample);

/// Whether the sample has numbers that stand for "no velocity": a component beyond any DVL's range,
/// such as -32.768 m/s, or a figure of merit of 10 m/s and more.
bool is_placeholder(const DvlSample& sample);

/// Makes samples with a placeholder for the velocity invalid (beams likewise), and removes
/// placeholders for other missing values: negative altitudes and ranges, and non-finite numbers
/// in optional fields and in the velocity of a sample or beam that is flagged invalid.
void clear_placeholder_values(DvlSample& sample);

}  // namespace apvi::io
