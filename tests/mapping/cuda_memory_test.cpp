// SPDX-License-Identifier: BSD-3-Clause
// Real out-of-memory errors on a GPU, by limiting LibTorch to its current allocation.
#include <c10/cuda/CUDACachingAllocator.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include "gaussians/device.hpp"
#include "mapping/evaluation.hpp"
#include "mapping/mapper.hpp"
#include "mapping/mapper_scene.hpp"
#include "support/posed_scene.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::mapping {
namespace {

using test::camera_at;

constexpr std::int64_t kGaussians = 50000;  // inserted per keyframe
constexpr int kMaxGaussians = 1000000;
constexpr double kMib = 1024.0 * 1024.0;

/// Limits LibTorch to its current GPU memory plus `spare` bytes during its lifetime.
class FullGpu {
 public:
  explicit FullGpu(double spare) {
    c10::cuda::CUDACachingAllocator::emptyCache();
    const auto held = c10::cuda::CUDACachingAllocator::getDeviceStats(0).reserved_bytes[0].current;
    const double total = kMib * gaussians::device_memory()->total_mib;
    c10::cuda::CUDACachingAllocator::setMemoryFraction((static_cast<double>(held) + spare) / total,
                                                       0);
  }
  ~FullGpu() { c10::cuda::CUDACachingAllocator::setMemoryFraction(1.0, 0); }
  FullGpu(const FullGpu&) = delete;
  FullGpu& operator=(const FullGpu&) = delete;
};

class CudaMemory : public testing::Test {
 protected:
  void SetUp() override {
    if (!gaussians::active_device().is_cuda()) GTEST_SKIP() << "no GPU that LibTorch can use";
  }
  static MapperOptions options() {
    MapperOptions options = small_map_options();
    options.trainer.densify.max_gaussians = kMaxGaussians;
    return options;
  }
  void learn_from(Mapper& mapper, int number) const {
    MapperInput input;
    input.keyframe = test::render_keyframe(world_, camera_at(0.1 * number, 0.0), number);
    input.points = points_of(world_, kGaussians * std::int64_t{number});
    mapper.add(input);
    for (int k = 0; k < 20; ++k) mapper.step();
  }

  gaussians::Gaussians world_ = test::gaussian_wall(kGaussians);
};

TEST_F(CudaMemory, MovesImagesToTheHostThenShrinksTheMap) {
  Mapper mapper(options());
  learn_from(mapper, 0);
  {
    const FullGpu full(64.0 * kMib);
    for (int number = 1; number < 12; ++number) ASSERT_NO_THROW(learn_from(mapper, number));
  }
  EXPECT_TRUE(mapper.keyframes().device().is_cpu());
  EXPECT_LT(mapper.max_gaussians(), kMaxGaussians);
  EXPECT_GT(mapper.size(), kGaussians / 2);
  EXPECT_LE(mapper.size(), mapper.max_gaussians());
  const auto psnr = mean_psnr(mapper.map(), mapper.keyframes(), mapper.keyframes().training());
  EXPECT_GT(psnr.value(), 20.0);
}

TEST_F(CudaMemory, PrunesACheckpointBeforeLoadingItToTheGpu) {
  const test::TmpDir dir;
  MapperOptions fewer = options();
  fewer.trainer.densify.max_gaussians = 2000;
  {
    Mapper mapper(options());
    for (int number = 0; number < 6; ++number) learn_from(mapper, number);
    ASSERT_GT(mapper.size(), 2 * kGaussians);
    mapper.save(dir.path() / "checkpoint.pt");
  }
  const FullGpu full(24.0 * kMib);
  Mapper resumed(fewer);
  ASSERT_NO_THROW(resumed.resume(dir.path() / "checkpoint.pt"));
  EXPECT_EQ(resumed.size(), 2000);
}

}  // namespace
}  // namespace apvi::mapping
