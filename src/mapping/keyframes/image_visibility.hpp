// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::mapping {

/// Whether an image [H,W,3] uint8 is black up to sensor noise. `scene` [H,W] bool: the pixels that
/// count; undefined: all. True if none does.
bool is_black(const torch::Tensor& image, const torch::Tensor& scene = {});

/// Whether a raw camera image [H,W,3] uint8 shows no scene although there is light: a silt cloud,
/// open water or over-exposure. True when fewer than a tenth of its cells (side: 1/80 of the width)
/// differ from their surroundings by more than the noise of a single pixel, or when half of its
/// pixels are saturated. The noise is estimated from differences of neighboring pixels (Immerkaer,
/// Fast noise variance estimation, 1996), so that faint but real detail such as bare sand counts as
/// visible; the estimate is bounded, so that fine gravel does not count as noise. Images narrower
/// than 320 px are only checked for saturation. Pixels that do not show the scene count as uniform.
bool has_low_visibility(const torch::Tensor& image, const torch::Tensor& scene = {});

}  // namespace apvi::mapping
