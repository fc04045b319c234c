// SPDX-License-Identifier: BSD-3-Clause
// With cuda_raster.cpp the only files that see LibTorch and CUDA: they hand the memory of tensors
// to the launchers.
#include <ATen/cuda/CUDAContext.h>
#include <c10/cuda/CUDAException.h>
#include <c10/cuda/CUDAGuard.h>
#include <torch/torch.h>

#include <algorithm>
#include <cmath>

#include "adam.hpp"
#include "apvi/splat/adam_backend.hpp"
#include "apvi/splat/loss_backend.hpp"
#include "apvi/splat/medium_backend.hpp"
#include "loss.hpp"
#include "medium.hpp"

namespace apvi::splat {
namespace {

using torch::Tensor;

cuda::MediumPointers to_pointers(const MediumInput& in) {
  return {.width = static_cast<int>(in.depth.size(1)),
          .height = static_cast<int>(in.depth.size(0)),
          .color = in.color.data_ptr<float>(),
          .depth = in.depth.data_ptr<float>(),
          .alpha = in.alpha.data_ptr<float>(),
          .ray_lengths = in.ray_lengths.defined() ? in.ray_lengths.data_ptr<float>() : nullptr,
          .beta_d = in.beta_d.data_ptr<float>(),
          .beta_b = in.beta_b.data_ptr<float>(),
          .b_inf = in.b_inf.data_ptr<float>(),
          .haze = haze_table<float>(in)};
}

cuda::LampPointers to_pointers(const LampInput& in) {
  cuda::LampPointers out = {.count = in.means.size(0),
                            .means = in.means.data_ptr<float>(),
                            .beta_d = in.beta_d.data_ptr<float>(),
                            .daylight = in.daylight.data_ptr<float>(),
                            .from_lamp = {},
                            .axis = {},
                            .sharpness = static_cast<float>(lamp_sharpness(in.lamp)),
                            .unit_range_m = static_cast<float>(in.unit_range_m),
                            .nearest_m = static_cast<float>(kLampNearest_m)};
  const auto T = in.T_camera_world.accessor<double, 2>();
  for (int k = 0; k < 3; ++k) {
    const auto axis = static_cast<std::size_t>(k);
    for (int c = 0; c < 4; ++c) out.from_lamp[4 * k + c] = static_cast<float>(T[k][c]);
    out.from_lamp[4 * k + 3] = static_cast<float>(T[k][3] - in.lamp.position_m[axis]);
    out.axis[k] = static_cast<float>(in.lamp.axis[axis]);
  }
  return out;
}

class CudaMediumBackend final : public MediumBackend {
 public:
  std::string_view name() const override { return "cuda"; }

  Tensor forward(const MediumInput& input) const override {
    const c10::cuda::CUDAGuard guard(input.color.device());
    Tensor image = torch::empty_like(input.color);
    C10_CUDA_CHECK(cuda::launch_medium_forward(to_pointers(input), image.data_ptr<float>(),
                                               at::cuda::getCurrentCUDAStream()));
    return image;
  }

  MediumInput backward(const MediumInput& input, const Tensor& grad_image,
                       bool by_water) const override {
    const c10::cuda::CUDAGuard guard(input.color.device());
    MediumInput out;
    out.color = torch::empty_like(input.color);
    out.depth = torch::empty_like(input.depth);
    out.alpha = torch::empty_like(input.alpha);
    const std::int64_t scalars = cuda::kMediumScalars;
    const Tensor sums =
        by_water ? torch::empty({scalars * (cuda::kMediumBlocks + 1)}, input.color.options())
                 : Tensor();
    float* const partials = by_water ? sums.data_ptr<float>() : nullptr;
    C10_CUDA_CHECK(cuda::launch_medium_backward(
        to_pointers(input), grad_image.data_ptr<float>(),
        {.color = out.color.data_ptr<float>(),
         .depth = out.depth.data_ptr<float>(),
         .alpha = out.alpha.data_ptr<float>(),
         .partials = partials,
         .scalars = by_water ? partials + scalars * cuda::kMediumBlocks : nullptr},
        at::cuda::getCurrentCUDAStream()));
    if (!by_water) return out;
    const Tensor totals = sums.narrow(0, scalars * cuda::kMediumBlocks, scalars).view({3, 3});
    out.beta_d = totals[0];
    out.beta_b = totals[1];
    out.b_inf = totals[2];
    return out;
  }

  Tensor lamp_light(const LampInput& input) const override {
    const c10::cuda::CUDAGuard guard(input.means.device());
    Tensor light = torch::empty_like(input.means);
    C10_CUDA_CHECK(cuda::launch_lamp_light(to_pointers(input), light.data_ptr<float>(),
                                           at::cuda::getCurrentCUDAStream()));
    return light;
  }
};

class CudaLossBackend final : public LossBackend {
 public:
  std::string_view name() const override { return "cuda"; }

  LossOutput forward(const LossInput& input, bool keep_for_backward) const override {
    const c10::cuda::CUDAGuard guard(input.image.device());
    const auto options = input.image.options();
    const cuda::LossImages images = to_images(input);
    const std::int64_t blocks = cuda::loss_blocks(images.width, images.height);
    const std::int64_t kept = keep_for_backward ? cuda::kLossMaps * input.image.numel() : 0;
    LossOutput out = {.loss = torch::empty({}, options), .kept = torch::empty({kept + 1}, options)};
    const Tensor partials = torch::empty({blocks, 3}, options);
    auto* const share = out.kept.data_ptr<float>();
    C10_CUDA_CHECK(cuda::launch_loss_forward(images, keep_for_backward ? share + 1 : nullptr,
                                             partials.data_ptr<float>(), out.loss.data_ptr<float>(),
                                             share, at::cuda::getCurrentCUDAStream()));
    if (!keep_for_backward) out.kept = Tensor();
    return out;
  }

  Tensor backward(const LossInput& input, const Tensor& kept,
                  const Tensor& by_loss) const override {
    const c10::cuda::CUDAGuard guard(input.image.device());
    Tensor gradient = torch::empty_like(input.image);
    const auto* const share = kept.data_ptr<float>();
    C10_CUDA_CHECK(cuda::launch_loss_backward(to_images(input), share + 1, share,
                                              by_loss.data_ptr<float>(), gradient.data_ptr<float>(),
                                              at::cuda::getCurrentCUDAStream()));
    return gradient;
  }

 private:
  static cuda::LossImages to_images(const LossInput& in) {
    return {.width = static_cast<int>(in.image.size(1)),
            .height = static_cast<int>(in.image.size(0)),
            .image = in.image.data_ptr<float>(),
            .target = in.target.data_ptr<float>(),
            .valid = in.valid.defined() ? in.valid.data_ptr<float>() : nullptr,
            .ssim_weight = static_cast<float>(in.ssim_weight)};
  }
};

class CudaAdamBackend final : public AdamBackend {
 public:
  std::string_view name() const override { return "cuda"; }

  void step(const std::vector<AdamGroup>& groups, std::int64_t steps, const AdamOptions& options,
            const Tensor& visible) const override {
    const c10::cuda::CUDAGuard guard(groups.front().parameter.device());
    const cuda::AdamFactors factors = to_factors(steps, options);
    const std::vector<cuda::AdamGroupPointers> pointers = to_pointers(groups, steps, options);
    const bool* const mask = visible.defined() ? visible.data_ptr<bool>() : nullptr;
    for (std::size_t k = 0; k < pointers.size(); k += cuda::kMaxAdamGroups) {
      const std::size_t count = std::min<std::size_t>(cuda::kMaxAdamGroups, pointers.size() - k);
      C10_CUDA_CHECK(cuda::launch_adam(pointers.data() + k, static_cast<int>(count), factors, mask,
                                       at::cuda::getCurrentCUDAStream()));
    }
  }

  void step_rows(const std::vector<AdamGroup>& groups, const GaussianRows& rows, std::int64_t steps,
                 const AdamOptions& options, bool visible_only) const override {
    const c10::cuda::CUDAGuard guard(rows.row.device());
    C10_CUDA_CHECK(cuda::launch_adam_rows(
        to_pointers(groups, steps, options).data(), rows.row.size(0),
        {.row = rows.row.data_ptr<std::int32_t>(),
         .rows = rows.values.data_ptr<float>(),
         .sh_degree = rows.sh_degree},
        to_factors(steps, options), visible_only, at::cuda::getCurrentCUDAStream()));
  }

 private:
  static cuda::AdamFactors to_factors(std::int64_t steps, const AdamOptions& options) {
    const auto n = static_cast<double>(steps);
    return {.keep_first = static_cast<float>(options.beta1),
            .keep_second = static_cast<float>(options.beta2),
            .root_scale = static_cast<float>(1.0 / std::sqrt(1.0 - std::pow(options.beta2, n))),
            .epsilon = static_cast<float>(options.epsilon),
            .seed = static_cast<unsigned>(steps) * 0x9e3779b9U};
  }

  static std::vector<cuda::AdamGroupPointers> to_pointers(const std::vector<AdamGroup>& groups,
                                                          std::int64_t steps,
                                                          const AdamOptions& options) {
    const double scale = 1.0 / (1.0 - std::pow(options.beta1, static_cast<double>(steps)));
    std::vector<cuda::AdamGroupPointers> out;
    for (const AdamGroup& group : groups) {
      const std::int64_t values = group.parameter.numel();
      const std::int64_t rows = group.parameter.dim() == 0 ? 1 : group.parameter.size(0);
      const Tensor& gradient = group.gradient;
      out.push_back({.values = values,
                     .width = rows == 0 ? 0 : values / rows,
                     .parameter = group.parameter.data_ptr<float>(),
                     .gradient = gradient.defined() ? gradient.data_ptr<float>() : nullptr,
                     .first = group.first.data_ptr(),
                     .second = group.second.data_ptr(),
                     .cut = group.first.scalar_type() == torch::kBFloat16,
                     .rate = static_cast<float>(group.rate * scale)});
    }
    return out;
  }
};

}  // namespace

const MediumBackend& cuda_medium_backend() {
  static const CudaMediumBackend backend;
  return backend;
}

const LossBackend& cuda_loss_backend() {
  static const CudaLossBackend backend;
  return backend;
}

const AdamBackend& cuda_adam_backend() {
  static const CudaAdamBackend backend;
  return backend;
}

}  // namespace apvi::splat
