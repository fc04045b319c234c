// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/splat/losses.hpp"

#include <torch/torch.h>

#include "apvi/splat/loss_backend.hpp"

namespace apvi::splat {
namespace {

using torch::Tensor;
using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

struct PhotometricLoss : torch::autograd::Function<PhotometricLoss> {
  /// `others` is the input without the image, the one thing that gets a derivative.
  static Tensor forward(AutogradContext* context, const Tensor& image, LossInput others,
                        bool needs_backward) {
    LossInput& input = others;
    input.image = image.contiguous();
    const LossOutput out = loss_backend(image.device()).forward(input, needs_backward);
    if (needs_backward) {
      context->save_for_backward({input.image, input.target, input.valid, out.kept});
      context->saved_data["ssim_weight"] = input.ssim_weight;
    }
    return out.loss;
  }

  static variable_list backward(AutogradContext* context, const variable_list& grads) {
    const variable_list saved = context->get_saved_variables();
    const LossInput input = {.image = saved[0],
                             .target = saved[1],
                             .valid = saved[2],
                             .ssim_weight = context->saved_data["ssim_weight"].toDouble()};
    return {loss_backend(input.image.device()).backward(input, saved[3], grads[0].contiguous()),
            Tensor(), Tensor()};
  }
};

}  // namespace

Tensor photometric_loss(const Tensor& image, const Tensor& target, double ssim_weight,
                        const Tensor& valid) {
  TORCH_CHECK(image.dim() == 3 && image.size(2) == 3 && image.numel() > 0,
              "loss: the image must be [H,W,3] and not empty, not ", image.sizes());
  TORCH_CHECK(target.sizes() == image.sizes(), "loss: the target has shape ", target.sizes(),
              " instead of ", image.sizes());
  TORCH_CHECK(target.scalar_type() == image.scalar_type() && target.device() == image.device(),
              "loss: the target is ", target.toString(), ", but the image ", image.toString());
  TORCH_CHECK(ssim_weight >= 0.0 && ssim_weight <= 1.0, "loss: the weight of SSIM must lie in ",
              "[0, 1], not ", ssim_weight);
  LossInput others = {
      .image = {}, .target = target.detach().contiguous(), .valid = {}, .ssim_weight = ssim_weight};
  if (valid.defined()) {
    TORCH_CHECK(valid.dim() == 2 && valid.size(0) == image.size(0) &&
                    valid.size(1) == image.size(1) && valid.device() == image.device(),
                "loss: the mask must be [H,W] like the image ", image.sizes(), ", not ",
                valid.sizes());
    others.valid = valid.detach().to(image.scalar_type()).contiguous();
  }
  const bool needs_backward = torch::GradMode::is_enabled() && image.requires_grad();
  return PhotometricLoss::apply(image, others, needs_backward);
}

}  // namespace apvi::splat
