// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/metrics/lpips.hpp"

#include <fmt/format.h>
#include <torch/torch.h>

#include <array>
#include <cstdlib>
#include <utility>

#include "gaussians/metrics/lpips_weights.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

constexpr std::size_t kStages = 5;
constexpr std::int64_t kMinSide = 32;

struct Convolution {
  std::int64_t in, out, kernel, stride, padding;
  std::int64_t pool_before;  ///< kernel of the max pooling before it, stride 2; 0: none
  bool is_stage;             ///< its output is compared
};

const std::vector<Convolution>& layers_of(LpipsNet net) {
  static const std::vector<Convolution> alex = {{3, 64, 11, 4, 2, 0, true},
                                                {64, 192, 5, 1, 2, 3, true},
                                                {192, 384, 3, 1, 1, 3, true},
                                                {384, 256, 3, 1, 1, 0, true},
                                                {256, 256, 3, 1, 1, 0, true}};
  static const std::vector<Convolution> vgg = {
      {3, 64, 3, 1, 1, 0, false},    {64, 64, 3, 1, 1, 0, true},  //
      {64, 128, 3, 1, 1, 2, false},  {128, 128, 3, 1, 1, 0, true}, {128, 256, 3, 1, 1, 2, false},
      {256, 256, 3, 1, 1, 0, false}, {256, 256, 3, 1, 1, 0, true}, {256, 512, 3, 1, 1, 2, false},
      {512, 512, 3, 1, 1, 0, false}, {512, 512, 3, 1, 1, 0, true}, {512, 512, 3, 1, 1, 2, false},
      {512, 512, 3, 1, 1, 0, false}, {512, 512, 3, 1, 1, 0, true}};
  return net == LpipsNet::alex ? alex : vgg;
}

std::string file_key(LpipsNet net) {
  return net == LpipsNet::alex ? "alex" : "vgg";
}

std::vector<NamedShape> shapes_of(LpipsNet net) {
  std::vector<NamedShape> shapes;
  std::vector<NamedShape> linear;
  for (const Convolution& layer : layers_of(net)) {
    const std::size_t k = shapes.size() / 2;
    shapes.push_back(
        {fmt::format("conv{}.weight", k), {layer.out, layer.in, layer.kernel, layer.kernel}});
    shapes.push_back({fmt::format("conv{}.bias", k), {layer.out}});
    if (layer.is_stage) linear.push_back({fmt::format("linear{}", linear.size()), {layer.out}});
  }
  shapes.insert(shapes.end(), linear.begin(), linear.end());
  return shapes;
}

/// Images [H,W,3] in [0, 1] as a batch [1,3,H,W], normalized as in the training of the networks.
Tensor network_input(const Tensor& image) {
  TORCH_CHECK(image.dim() == 3 && image.size(2) == 3 && image.size(0) >= kMinSide &&
                  image.size(1) >= kMinSide,
              "LPIPS: the image must be [H,W,3] with sides of 32 or more, not ", image.sizes());
  const auto options = torch::dtype(torch::kFloat32).device(image.device());
  const Tensor shift = torch::tensor({-0.030, -0.088, -0.188}, options);
  const Tensor scale = torch::tensor({0.458, 0.448, 0.450}, options);
  const Tensor centered = 2.0 * image.to(torch::kFloat32) - 1.0;
  return ((centered - shift) / scale).permute({2, 0, 1}).unsqueeze(0).contiguous();
}

/// Features [1,C,h,w] normalized per pixel.
Tensor unit_features(const Tensor& features) {
  return features / (features.square().sum(1, true).sqrt() + 1e-10);
}

std::array<Tensor, kStages> features_of(const Tensor& image, LpipsNet net,
                                        const std::vector<Tensor>& tensors) {
  std::array<Tensor, kStages> stages;
  std::size_t stage = 0;
  Tensor x = network_input(image);
  const std::vector<Convolution>& layers = layers_of(net);
  for (std::size_t i = 0; i < layers.size(); ++i) {
    const Convolution& layer = layers[i];
    if (layer.pool_before > 0) x = torch::max_pool2d(x, layer.pool_before, 2);
    x = torch::relu(
        torch::conv2d(x, tensors[2 * i], tensors[2 * i + 1], layer.stride, layer.padding));
    if (layer.is_stage) stages.at(stage++) = unit_features(x);
  }
  return stages;
}

}  // namespace

std::string_view net_name(LpipsNet net) {
  return net == LpipsNet::alex ? "AlexNet" : "VGG-16";
}

std::filesystem::path lpips_folder() {
  const auto variable = [](const char* name) -> std::string_view {
    const char* const value = std::getenv(name);
    return value == nullptr ? "" : value;
  };
  if (const auto own = variable("APVI_LPIPS"); !own.empty()) return own;
  if (const auto share = variable("XDG_DATA_HOME"); !share.empty()) {
    return std::filesystem::path(share) / "apvi";
  }
  return std::filesystem::path(variable("HOME")) / ".local" / "share" / "apvi";
}

std::optional<Lpips> Lpips::load(LpipsNet net, const std::filesystem::path& folder) {
  const std::filesystem::path file = folder / fmt::format("lpips_{}.bin", file_key(net));
  if (!std::filesystem::exists(file)) return std::nullopt;
  return Lpips(net, read_lpips_weights(file, file_key(net), shapes_of(net)));
}

Lpips::Lpips(LpipsNet net, std::vector<Tensor> tensors) : net_(net), tensors_(std::move(tensors)) {}

double Lpips::operator()(const Tensor& a, const Tensor& b) const {
  TORCH_CHECK(a.sizes() == b.sizes() && a.device() == b.device(), "LPIPS: images ", a.sizes(),
              " and ", b.sizes(), " do not match");
  const torch::NoGradGuard no_grad;
  std::vector<Tensor> tensors;
  for (const Tensor& tensor : tensors_) tensors.push_back(tensor.to(a.device()));
  const auto features_a = features_of(a, net_, tensors);
  const auto features_b = features_of(b, net_, tensors);
  double distance = 0.0;
  for (std::size_t stage = 0; stage < kStages; ++stage) {
    const Tensor& linear = tensors[tensors.size() - kStages + stage];
    const Tensor difference = (features_a.at(stage) - features_b.at(stage)).square();
    distance += (difference * linear.view({1, -1, 1, 1})).sum(1).mean().item<double>();
  }
  return distance;
}

}  // namespace apvi::gaussians
