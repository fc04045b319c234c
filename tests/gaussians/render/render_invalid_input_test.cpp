// SPDX-License-Identifier: BSD-3-Clause
// Rendering of invalid or extreme maps and views.
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <limits>

#include "gaussians/render/render.hpp"
#include "gaussians/render/render_scene.hpp"
#include "support/torch_reference.hpp"

namespace apvi::gaussians {
namespace {

using apvi::test::tensors_near;
using test::make_gaussians;
using test::make_view;
using test::map_tensors;
using torch::Tensor;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

class RenderInvalidInput : public testing::TestWithParam<torch::TensorOptions> {
 protected:
  Gaussians make(std::int64_t count) const {
    return map_tensors(make_gaussians(count), [](const Tensor& t) { return t.to(GetParam()); });
  }
};

/// Renders and differentiates; whether all images and gradients are finite.
bool all_finite(const Gaussians& gaussians, const View& view) {
  const Gaussians leaves =
      map_tensors(gaussians, [](const Tensor& t) { return t.clone().requires_grad_(true); });
  const RenderOutput drawn = render(leaves, view, {});
  (drawn.color.sum() + drawn.depth.sum() + drawn.alpha.sum()).backward();
  bool finite = torch::isfinite(drawn.color).all().item<bool>() &&
                torch::isfinite(drawn.depth).all().item<bool>() &&
                torch::isfinite(drawn.statistics.mean2d_gradient).all().item<bool>();
  for (const Tensor* tensor : leaves.tensors()) {
    finite = finite && torch::isfinite(tensor->grad()).all().item<bool>();
  }
  return finite;
}

TEST_P(RenderInvalidInput, NonFiniteGaussianIsCulledWithoutSideEffects) {
  const View view = make_view();
  const Gaussians good = make(33);
  const Tensor expected =
      render(map_tensors(good, [](const Tensor& t) { return t.slice(0, 1); }), view, {}).color;
  for (const double poison : {kNan, kInfinity}) {
    for (std::size_t i = 0; i < 6; ++i) {
      Gaussians bad = map_tensors(good, [](const Tensor& t) { return t.clone(); });
      if (poison == kInfinity && i == 3) continue;  // opaque, a valid value
      bad.tensors()[i]->slice(0, 0, 1).fill_(poison);
      const RenderOutput drawn = render(bad, view, {});
      EXPECT_TRUE(tensors_near(drawn.color, expected, 1e-6)) << "tensor " << i << ", " << poison;
      EXPECT_FALSE(drawn.statistics.visible[0].item<bool>()) << "tensor " << i << ", " << poison;
      EXPECT_TRUE(all_finite(bad, view)) << "tensor " << i << ", " << poison;
    }
  }
}

TEST_P(RenderInvalidInput, ZeroQuaternionIsCulled) {
  Gaussians bad = make(5);
  bad.quaternions.slice(0, 2, 3).zero_();
  EXPECT_FALSE(render(bad, make_view(), {}).statistics.visible[2].item<bool>());
  EXPECT_TRUE(all_finite(bad, make_view()));
}

TEST_P(RenderInvalidInput, ZeroScaleGaussianHasLowPassFootprint) {
  Gaussians dots = make(5);
  dots.log_scales.fill_(-kInfinity);
  dots.logit_opacities.fill_(0.0);
  const RenderOutput drawn = render(dots, make_view(), {});
  EXPECT_TRUE(all_finite(dots, make_view()));
  EXPECT_NEAR(drawn.statistics.radii_px.max().item<double>(), std::sqrt(0.3 * 2 * std::log(127.5)),
              1e-2);
}

TEST_P(RenderInvalidInput, HugeGaussiansStayFinite) {
  Gaussians huge = make(9);
  huge.log_scales.fill_(8.0);
  EXPECT_TRUE(all_finite(huge, make_view()));
  huge.log_scales.fill_(80.0);
  EXPECT_TRUE(all_finite(huge, make_view()));
}

TEST_P(RenderInvalidInput, EmptyMapShowsBackground) {
  const torch::TensorOptions options = GetParam();
  RenderOptions blue;
  blue.background = torch::tensor({0.0, 0.1, 0.7}, options);
  const RenderOutput drawn = render(Gaussians::empty(3, options), make_view(), blue);
  EXPECT_TRUE(torch::equal(drawn.color, blue.background.expand_as(drawn.color)));
  EXPECT_EQ(drawn.alpha.abs().max().item<double>(), 0.0);
  EXPECT_TRUE(all_finite(Gaussians::empty(0, options), make_view()));
}

TEST_P(RenderInvalidInput, GaussiansBehindCameraAreCulled) {
  Gaussians behind = make(50);
  behind.means.select(1, 2).mul_(-1.0);
  const RenderOutput drawn = render(behind, make_view(), {});
  EXPECT_EQ(drawn.alpha.abs().max().item<double>(), 0.0);
  EXPECT_FALSE(drawn.statistics.visible.any().item<bool>());
  EXPECT_TRUE(all_finite(behind, make_view()));
}

TEST_P(RenderInvalidInput, SupportsOnePixelImage) {
  View view = make_view();
  view.intrinsics = view.intrinsics.scaled(1, 1);
  const RenderOutput drawn = render(make(50), view, {});
  EXPECT_EQ(drawn.color.sizes(), at::IntArrayRef({1, 1, 3}));
  EXPECT_GT(drawn.alpha.item<double>(), 0.0);
  EXPECT_TRUE(all_finite(make(50), view));
}

TEST_P(RenderInvalidInput, RejectsInvalidArguments) {
  const Gaussians good = make(4);
  const View view = make_view();
  Gaussians bad = good;
  bad.quaternions = good.quaternions.slice(1, 0, 3);
  EXPECT_THROW(render(bad, view, {}), c10::Error);
  bad = good;
  bad.sh_rest = good.sh_rest.slice(1, 0, 7);
  EXPECT_THROW(render(bad, view, {}), c10::Error);
  bad = good;
  bad.means = Tensor();
  EXPECT_THROW(render(bad, view, {}), c10::Error);
  View wrong = view;
  wrong.intrinsics.width = 0;
  EXPECT_THROW(render(good, wrong, {}), c10::Error);
  wrong = view;
  wrong.intrinsics.fx = kNan;
  EXPECT_THROW(render(good, wrong, {}), c10::Error);
  wrong = view;
  wrong.T_camera_world = view.T_camera_world * kNan;
  EXPECT_THROW(render(good, wrong, {}), c10::Error);
  wrong = view;
  wrong.pose_delta = torch::zeros({4});
  EXPECT_THROW(render(good, wrong, {}), c10::Error);
  RenderOptions options;
  options.background = torch::zeros({4});
  EXPECT_THROW(render(good, view, options), c10::Error);
}

TEST(RenderLargeMap, TenMillionGaussiansRenderOrThrow) {
  const std::int64_t count = 10'000'000;
  // Expanded views of one row: the map itself takes no memory, only rendering does.
  const Gaussians one = make_gaussians(1, torch::kFloat32, 0);
  Gaussians many = map_tensors(one, [count](const Tensor& t) {
    std::vector<std::int64_t> shape = t.sizes().vec();
    shape[0] = count;
    return t.expand(shape);
  });
  many.logit_opacities = torch::full({count}, -5.0F);
  try {
    const RenderOutput drawn = render(many, make_view(16, 16), {});
    EXPECT_TRUE(torch::isfinite(drawn.color).all().item<bool>());
    EXPECT_EQ(drawn.statistics.visible.size(0), count);
  } catch (const c10::Error& error) {
    EXPECT_NE(std::string(error.what()), "");
  }
}

std::vector<torch::TensorOptions> kinds() {
  std::vector<torch::TensorOptions> out = {torch::dtype(torch::kFloat32),
                                           torch::dtype(torch::kFloat64)};
  if (APVI_WITH_CUDA && torch::cuda::is_available()) {
    out.push_back(torch::dtype(torch::kFloat32).device(torch::kCUDA));
  }
  return out;
}
INSTANTIATE_TEST_SUITE_P(Kinds, RenderInvalidInput, testing::ValuesIn(kinds()),
                         [](const auto& kind) {
                           if (kind.param.device().is_cuda()) return "cuda";
                           return kind.param.dtype() == torch::kFloat32 ? "float" : "double";
                         });

}  // namespace
}  // namespace apvi::gaussians
