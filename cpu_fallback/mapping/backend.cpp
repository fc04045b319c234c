// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/depth_backend.hpp"
#include "depth_sweep.hpp"

namespace apvi::mapping {
namespace {

class CpuDepthBackend final : public DepthBackend {
 public:
  std::string_view name() const override { return "cpu"; }
  SweepPictures prepare(const std::vector<torch::Tensor>& greys) const override {
    return cpu::make_pyramids(greys);
  }
  SweepOutput sweep(const SweepPictures& pictures, const SweepInput& input) const override {
    return cpu::sweep(pictures, input);
  }
  torch::Tensor propagate(const BeliefInput& input) const override { return cpu::propagate(input); }
  Surfaces surfaces(const SurfaceInput& input) const override { return cpu::surfaces(input); }
  torch::Tensor smooth(const SmoothInput& input) const override { return cpu::smooth(input); }
};

}  // namespace

const DepthBackend& cpu_depth_backend() {
  static const CpuDepthBackend backend;
  return backend;
}

}  // namespace apvi::mapping
