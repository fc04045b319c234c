// SPDX-License-Identifier: BSD-3-Clause
#include "survey/color_rule.hpp"

#include <torch/torch.h>

namespace apvi::survey {

torch::Tensor ColorRule::operator()(const torch::Tensor& light) const {
  if (!transmission.defined()) return mapping::displayed(light, exposure, curve);
  return curve.encode(light * transmission.to(light.options())).clamp(0.0, 1.0);
}

}  // namespace apvi::survey
