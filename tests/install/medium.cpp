// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/splat/medium.hpp"

#include <cstdio>

/// Sees a white wall through water, by an installed apvi with its mapping half; status 0 when the
/// colour is right.
int main() {
  const apvi::splat::Medium water = {torch::full({3}, 0.5F), torch::full({3}, 0.5F),
                                     torch::full({3}, 0.25F)};
  const torch::Tensor image = apvi::splat::apply_medium(
      torch::ones({1, 1, 3}), torch::full({1, 1}, 2.0F), torch::ones({1, 1}), water);
  const float red = image[0][0][0].item<float>();
  std::printf("a white wall through 2 m of water: %.4f\n", static_cast<double>(red));
  return red > 0.5258F && red < 0.5261F ? 0 : 1;  // exp(-1) + 0.25 (1 - exp(-1))
}
