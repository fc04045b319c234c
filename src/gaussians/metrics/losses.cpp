// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/metrics/losses.hpp"

#include <torch/torch.h>

#include "gaussians/metrics/loss_backend.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;
using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

struct PhotometricLoss : torch::autograd::Function<PhotometricLoss> {
  /// `inputs` holds everything but the image, the only differentiable input.
  static Tensor forward(AutogradContext* context, const Tensor& image, LossInput inputs,
                        bool needs_backward) {
    LossInput& input = inputs;
    input.image = image.contiguous();
    const LossOutput out = loss_backend(image.device()).forward(input, needs_backward);
    if (needs_backward) {
      context->save_for_backward({input.image, input.target, input.valid, out.saved});
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
  TORCH_CHECK(ssim_weight >= 0.0 && ssim_weight <= 1.0, "loss: ssim_weight must be in ",
              "[0, 1], not ", ssim_weight);
  LossInput inputs = {
      .image = {}, .target = target.detach().contiguous(), .valid = {}, .ssim_weight = ssim_weight};
  if (valid.defined()) {
    TORCH_CHECK(valid.dim() == 2 && valid.size(0) == image.size(0) &&
                    valid.size(1) == image.size(1) && valid.device() == image.device(),
                "loss: the mask must be [H,W] like the image ", image.sizes(), ", not ",
                valid.sizes());
    inputs.valid = valid.detach().to(image.scalar_type()).contiguous();
  }
  const bool needs_backward = torch::GradMode::is_enabled() && image.requires_grad();
  return PhotometricLoss::apply(image, inputs, needs_backward);
}

}  // namespace apvi::gaussians
