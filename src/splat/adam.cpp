// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/splat/adam.hpp"

#include <torch/torch.h>

#include "apvi/splat/adam_backend.hpp"

namespace apvi::splat {
namespace {

using torch::Tensor;

void check_like(const Tensor& tensor, const char* name, const Tensor& parameter) {
  TORCH_CHECK(tensor.defined() && tensor.sizes() == parameter.sizes() &&
                  tensor.scalar_type() == parameter.scalar_type() &&
                  tensor.device() == parameter.device(),
              "adam: ", name, " does not fit the parameter, which is ", parameter.toString(),
              parameter.sizes());
  TORCH_CHECK(tensor.is_contiguous(), "adam: ", name, " is not contiguous");
}

void check_group(const AdamGroup& group, const Tensor& visible) {
  check_like(group.parameter, "the parameter", group.parameter);
  check_like(group.first, "the first moment", group.parameter);
  check_like(group.second, "the second moment", group.parameter);
  if (!visible.defined()) return;
  TORCH_CHECK(visible.scalar_type() == torch::kBool && visible.dim() == 1 &&
                  visible.is_contiguous() && group.parameter.dim() > 0 &&
                  visible.size(0) == group.parameter.size(0) &&
                  visible.device() == group.parameter.device(),
              "adam: the mask must be bool [N], one value a row of the parameter ",
              group.parameter.sizes(), ", not ", visible.toString(), visible.sizes());
}

}  // namespace

void adam_step(const std::vector<AdamGroup>& groups, std::int64_t steps, const AdamOptions& options,
               const Tensor& visible) {
  TORCH_CHECK(steps > 0, "adam: the first step is number 1, not ", steps);
  std::vector<AdamGroup> moving;
  for (const AdamGroup& group : groups) {
    check_group(group, visible);
    if (!group.gradient.defined()) continue;
    moving.push_back(group);
    moving.back().gradient = group.gradient.detach().contiguous();
    check_like(moving.back().gradient, "the gradient", group.parameter);
  }
  if (moving.empty()) return;
  adam_backend(moving.front().parameter.device()).step(moving, steps, options, visible);
}

void adam_step_rows(const std::vector<AdamGroup>& groups, const GaussianRows& rows,
                    std::int64_t steps, const AdamOptions& options, bool visible_only) {
  TORCH_CHECK(steps > 0, "adam: the first step is number 1, not ", steps);
  TORCH_CHECK(groups.size() == 6, "adam: a map has six groups of parameters, not ", groups.size());
  const Tensor& means = groups.front().parameter;
  for (const AdamGroup& group : groups) {
    check_group(group, {});
    TORCH_CHECK(group.parameter.size(0) == means.size(0), "adam: the groups are of ", means.size(0),
                " and of ", group.parameter.size(0), " Gaussians");
  }
  TORCH_CHECK(rows.row.defined() && rows.row.sizes() == at::IntArrayRef({means.size(0)}) &&
                  rows.row.device() == means.device(),
              "adam: the rows are of another map");
  adam_backend(means.device()).step_rows(groups, rows, steps, options, visible_only);
}

void AdamBackend::step_rows(const std::vector<AdamGroup>& /*groups*/, const GaussianRows& /*rows*/,
                            std::int64_t /*steps*/, const AdamOptions& /*options*/,
                            bool /*visible_only*/) const {
  TORCH_CHECK(false, "adam: the backend ", name(), " knows no rows of derivatives");
}

}  // namespace apvi::splat
