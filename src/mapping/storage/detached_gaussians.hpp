// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

#include "mapping/training/map_optimizer.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// The tensors with a row per Gaussian.
std::vector<torch::Tensor*> tensors_of(DetachedGaussians& detached);

/// The result of `function` for each of these tensors.
template <typename Function>
DetachedGaussians map_tensors(DetachedGaussians detached, Function function) {
  for (torch::Tensor* tensor : tensors_of(detached)) *tensor = function(*tensor);
  return detached;
}

/// Saves Gaussians bitwise, but not their appearance or motions.
void save(torch::serialize::OutputArchive& archive, const DetachedGaussians& detached);
/// Loads what `save` wrote. Throws c10::Error when tensors do not match.
DetachedGaussians load_detached(torch::serialize::InputArchive& archive);

/// Saves what `recolor` needs of a map: medium, gains and camera response, but no Gaussians.
void save_appearance(torch::serialize::OutputArchive& archive, const Map& map);
Map load_appearance(torch::serialize::InputArchive& archive);
/// Number of keyframes whose gains are known.
std::int64_t known_keyframes(const Map& appearance);

}  // namespace apvi::mapping
