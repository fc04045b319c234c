// SPDX-License-Identifier: BSD-3-Clause
#include "cpu_fallback/depth/depth_sweep.hpp"
#include "depth/depth_backend.hpp"

namespace apvi::depth {
namespace {

class CpuDepthBackend final : public DepthBackend {
 public:
  std::string_view name() const override { return "cpu"; }
  SweepImages prepare(const std::vector<torch::Tensor>& grays) const override {
    return cpu::make_pyramids(grays);
  }
  SweepOutput sweep(const SweepImages& images, const SweepInput& input) const override {
    return cpu::sweep(images, input);
  }
  torch::Tensor propagate(const BeliefPropagationInput& input) const override {
    return cpu::propagate(input);
  }
  FittedPlanes fit_planes(const PlaneFitInput& input) const override {
    return cpu::fit_planes(input);
  }
  torch::Tensor smooth(const SmoothInput& input) const override { return cpu::smooth(input); }
};

}  // namespace

const DepthBackend& cpu_depth_backend() {
  static const CpuDepthBackend backend;
  return backend;
}

}  // namespace apvi::depth
