// SPDX-License-Identifier: BSD-3-Clause
// Passes tensor memory to the kernel launchers of the medium.
#include <ATen/cuda/CUDAContext.h>
#include <c10/cuda/CUDAException.h>
#include <c10/cuda/CUDAGuard.h>
#include <torch/torch.h>

#include "kernels/medium/medium.hpp"
#include "medium/medium_backend.hpp"

namespace apvi::medium {
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
          .lamp_backscatter = backscatter_table<float>(in)};
}

static_assert(kMaxLamps == cuda::kMaxLamps);

cuda::LampBeam to_beam(const Lamp& lamp) {
  const BeamProfile profile = beam_profile(lamp);
  cuda::LampBeam beam = {.position = {},
                         .axis = {},
                         .linear = static_cast<float>(profile.linear),
                         .square = static_cast<float>(profile.square),
                         .share = static_cast<float>(lamp.share)};
  for (std::size_t k = 0; k < 3; ++k) {
    beam.position[k] = static_cast<float>(lamp.position_m[k]);
    beam.axis[k] = static_cast<float>(lamp.axis[k]);
  }
  return beam;
}

cuda::LampPointers to_pointers(const LampInput& in) {
  cuda::LampPointers out = {.count = in.means.size(0),
                            .means = in.means.data_ptr<float>(),
                            .beta_d = in.beta_d.data_ptr<float>(),
                            .daylight = in.daylight.data_ptr<float>(),
                            .T_camera_world = {},
                            .lamps = {},
                            .lamp_count = static_cast<int>(in.lamps.size()),
                            .unit_range_m = static_cast<float>(in.unit_range_m),
                            .nearest_m = static_cast<float>(kLampMinDistance_m)};
  const auto T = in.T_camera_world.accessor<double, 2>();
  for (int k = 0; k < 3; ++k) {
    for (int c = 0; c < 4; ++c) out.T_camera_world[4 * k + c] = static_cast<float>(T[k][c]);
  }
  TORCH_CHECK(in.lamps.size() <= kMaxLamps, "medium: more than ", kMaxLamps, " lamps");
  for (std::size_t j = 0; j < in.lamps.size(); ++j) out.lamps[j] = to_beam(in.lamps[j]);
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
                       bool with_medium_gradients) const override {
    const c10::cuda::CUDAGuard guard(input.color.device());
    MediumInput out;
    out.color = torch::empty_like(input.color);
    out.depth = torch::empty_like(input.depth);
    out.alpha = torch::empty_like(input.alpha);
    const std::int64_t scalars = cuda::kMediumScalars;
    const Tensor sums = with_medium_gradients ? torch::empty({scalars * (cuda::kMediumBlocks + 1)},
                                                             input.color.options())
                                              : Tensor();
    float* const partials = with_medium_gradients ? sums.data_ptr<float>() : nullptr;
    C10_CUDA_CHECK(cuda::launch_medium_backward(
        to_pointers(input), grad_image.data_ptr<float>(),
        {.color = out.color.data_ptr<float>(),
         .depth = out.depth.data_ptr<float>(),
         .alpha = out.alpha.data_ptr<float>(),
         .partials = partials,
         .scalars = with_medium_gradients ? partials + scalars * cuda::kMediumBlocks : nullptr},
        at::cuda::getCurrentCUDAStream()));
    if (!with_medium_gradients) return out;
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

}  // namespace

const MediumBackend& cuda_medium_backend() {
  static const CudaMediumBackend backend;
  return backend;
}

}  // namespace apvi::medium
