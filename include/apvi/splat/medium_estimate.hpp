// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

#include "apvi/splat/medium.hpp"

namespace apvi::splat {

/// Water to start from when the pictures tell nothing: that of a coast.
Medium coastal_medium();

/// A first guess of the water from a few pictures with ranges, good enough to start an optimiser.
/// `colors[i]` [H,W,3] in [0, 1] as the camera saw them, `ranges[i]` [H,W] along the ray [m], 0 or
/// not finite where there is none.
///
/// Assumes that the surfaces at all ranges are coloured alike. Then the contrast at range z falls
/// as exp(-beta_d z), whose logarithm is a line; and the darkest of them, which show most of the
/// water in front, run to b_inf as exp(-beta_b z), a linear fit for every beta_b tried. Pixels
/// without range count as water without end if they are of one colour. A channel that does not tell
/// keeps the coast's values. float64 on the CPU. Throws c10::Error when shapes do not fit.
Medium estimate_medium(const std::vector<torch::Tensor>& colors,
                       const std::vector<torch::Tensor>& ranges);

}  // namespace apvi::splat
