// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/optimizer/adam.hpp"

#include <torch/torch.h>

#include "gaussians/optimizer/adam_backend.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

void check_like(const Tensor& tensor, const char* name, const Tensor& parameter,
                torch::ScalarType type) {
  TORCH_CHECK(tensor.defined() && tensor.sizes() == parameter.sizes() &&
                  tensor.scalar_type() == type && tensor.device() == parameter.device(),
              "adam: ", name, " does not match the parameter, which is ", parameter.toString(),
              parameter.sizes());
  TORCH_CHECK(tensor.is_contiguous(), "adam: ", name, " is not contiguous");
}

/// Both moments have one type: the parameter's or that of `moment_type`.
void check_moments(const AdamGroup& group) {
  const Tensor& parameter = group.parameter;
  const bool cut = group.first.defined() && group.first.scalar_type() == moment_type(parameter);
  const torch::ScalarType type = cut ? moment_type(parameter) : parameter.scalar_type();
  check_like(group.first, "the first moment", parameter, type);
  check_like(group.second, "the second moment", parameter, type);
}

void check_group(const AdamGroup& group, const Tensor& visible) {
  check_like(group.parameter, "the parameter", group.parameter, group.parameter.scalar_type());
  check_moments(group);
  if (!visible.defined()) return;
  TORCH_CHECK(visible.scalar_type() == torch::kBool && visible.dim() == 1 &&
                  visible.is_contiguous() && group.parameter.dim() > 0 &&
                  visible.size(0) == group.parameter.size(0) &&
                  visible.device() == group.parameter.device(),
              "adam: the mask must be bool [N], one value per row of the parameter ",
              group.parameter.sizes(), ", not ", visible.toString(), visible.sizes());
}

}  // namespace

torch::ScalarType moment_type(const Tensor& parameter) {
  const torch::ScalarType type = parameter.scalar_type();
  return parameter.is_cuda() && type == torch::kFloat32 ? torch::kBFloat16 : type;
}

void adam_step(const std::vector<AdamGroup>& groups, std::int64_t steps, const AdamOptions& options,
               const Tensor& visible) {
  TORCH_CHECK(steps > 0, "adam: step numbers start at 1, not ", steps);
  std::vector<AdamGroup> active;
  for (const AdamGroup& group : groups) {
    check_group(group, visible);
    if (!group.gradient.defined()) continue;
    active.push_back(group);
    active.back().gradient = group.gradient.detach().contiguous();
    check_like(active.back().gradient, "the gradient", group.parameter,
               group.parameter.scalar_type());
  }
  if (active.empty()) return;
  adam_backend(active.front().parameter.device()).step(active, steps, options, visible);
}

void adam_step_sparse(const std::vector<AdamGroup>& groups, const SparseGradient& gradient,
                      std::int64_t steps, const AdamOptions& options, bool visible_only) {
  TORCH_CHECK(steps > 0, "adam: step numbers start at 1, not ", steps);
  TORCH_CHECK(groups.size() == 6, "adam: a map has six groups of parameters, not ", groups.size());
  const Tensor& means = groups.front().parameter;
  for (const AdamGroup& group : groups) {
    check_group(group, {});
    TORCH_CHECK(group.parameter.size(0) == means.size(0), "adam: groups of ", means.size(0),
                " and of ", group.parameter.size(0), " Gaussians do not match");
  }
  TORCH_CHECK(gradient.row.defined() && gradient.row.sizes() == at::IntArrayRef({means.size(0)}) &&
                  gradient.row.device() == means.device(),
              "adam: the sparse gradient belongs to another map");
  adam_backend(means.device()).step_sparse(groups, gradient, steps, options, visible_only);
}

void AdamBackend::step_sparse(const std::vector<AdamGroup>& /*groups*/,
                              const SparseGradient& /*gradient*/, std::int64_t /*steps*/,
                              const AdamOptions& /*options*/, bool /*visible_only*/) const {
  TORCH_CHECK(false, "adam: the backend ", name(), " does not support sparse gradients");
}

}  // namespace apvi::gaussians
