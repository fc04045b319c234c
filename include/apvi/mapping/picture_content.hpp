// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::mapping {

/// Whether nothing can be seen in a picture [H,W,3] uint8: noise of a sensor in the dark.
bool is_black(const torch::Tensor& image);

/// Whether a picture [H,W,3] uint8, as a camera made it, shows nothing of a scene though there is
/// light: a cloud of silt, open water, or over-exposure. Less than a tenth of its squares (an
/// eightieth of its width) stand out from those around them by as much as noise makes a pixel do,
/// several times what it makes a square do; or half of its pixels are saturated. The noise is what
/// differs between a pixel and its neighbours (Immerkaer, Fast noise variance estimation, 1996), so
/// bare sand, of little but real detail, is something; of gravel as fine as pixels no more passes
/// for noise than sensors have. Of a picture narrower than 320 pixels only saturation is told.
bool is_murky(const torch::Tensor& image);

}  // namespace apvi::mapping
