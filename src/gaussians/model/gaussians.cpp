// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/model/gaussians.hpp"

#include <torch/torch.h>

namespace apvi::gaussians {
namespace {

constexpr std::array<const char*, 6> kNames = {"means",           "log_scales", "quaternions",
                                               "logit_opacities", "sh_dc",      "sh_rest"};

int degree_of(std::int64_t rest_count) {
  for (int degree = 0; degree <= kMaxShDegree; ++degree) {
    if (sh_rest_count(degree) == rest_count) return degree;
  }
  return -1;
}

}  // namespace

int Gaussians::sh_degree() const {
  const int degree = sh_rest.defined() && sh_rest.dim() == 3 ? degree_of(sh_rest.size(1)) : -1;
  TORCH_CHECK(degree >= 0, "gaussians: sh_rest must be [N,K,3] with K of 0, 3, 8 or 15");
  return degree;
}

Gaussians Gaussians::empty(int sh_degree, const torch::TensorOptions& options) {
  TORCH_CHECK(sh_degree >= 0 && sh_degree <= kMaxShDegree, "gaussians: unsupported SH degree ",
              sh_degree);
  return {.means = torch::empty({0, 3}, options),
          .log_scales = torch::empty({0, 3}, options),
          .quaternions = torch::empty({0, 4}, options),
          .logit_opacities = torch::empty({0}, options),
          .sh_dc = torch::empty({0, 3}, options),
          .sh_rest = torch::empty({0, sh_rest_count(sh_degree), 3}, options)};
}

void check(const Gaussians& gaussians) {
  TORCH_CHECK(gaussians.means.defined() && gaussians.means.dim() == 2,
              "gaussians: means must be [N,3]");
  TORCH_CHECK(gaussians.means.is_floating_point(), "gaussians: means must be floating, not ",
              gaussians.means.scalar_type());
  const std::int64_t n = gaussians.size();
  const std::array<std::vector<std::int64_t>, 6> shapes = {
      {{n, 3}, {n, 3}, {n, 4}, {n}, {n, 3}, {n, sh_rest_count(gaussians.sh_degree()), 3}}};
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    const torch::Tensor& tensor = *gaussians.tensors()[i];
    TORCH_CHECK(tensor.defined(), "gaussians: ", kNames[i], " is missing");
    TORCH_CHECK(tensor.sizes() == at::IntArrayRef(shapes[i]), "gaussians: ", kNames[i],
                " has shape ", tensor.sizes(), " instead of ", at::IntArrayRef(shapes[i]));
    TORCH_CHECK(tensor.scalar_type() == gaussians.means.scalar_type() &&
                    tensor.device() == gaussians.means.device(),
                "gaussians: ", kNames[i], " is ", tensor.toString(), ", but means are ",
                gaussians.means.toString());
  }
}

}  // namespace apvi::gaussians
