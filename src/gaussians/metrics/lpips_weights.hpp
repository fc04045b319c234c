// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <filesystem>
#include <string>
#include <vector>

namespace apvi::gaussians {

struct NamedShape {
  std::string name;
  std::vector<std::int64_t> shape;
};

/// Reads a file of scripts/make_lpips_weights.py, which must hold exactly these tensors, float32.
/// Throws InputError describing the problem.
std::vector<torch::Tensor> read_lpips_weights(const std::filesystem::path& file,
                                              const std::string& net,
                                              const std::vector<NamedShape>& expected);

}  // namespace apvi::gaussians
