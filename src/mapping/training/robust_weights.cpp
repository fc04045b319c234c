// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/training/robust_weights.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <string>

#include "gaussians/host_values.hpp"
#include "gaussians/model/archive.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;
namespace F = torch::nn::functional;

constexpr std::int64_t kBlocks = 320;   // at least, along the longer side of a large image
constexpr std::int64_t kMinUses = 1;    // of a view, before its weights count
constexpr std::int64_t kInterval = 3;   // uses of a view between two searches for outliers
constexpr double kColorWeight = 4.0;    // of the color, against the difference
constexpr double kDark = 0.03;          // below, an image has no color
constexpr double kHigh = 4.0;           // times the running median: an outlier
constexpr double kLow = 2.5;            // the same for blocks connected to one
constexpr int kGrowth = 4;              // that are at most so many blocks away
constexpr double kMinResidual = 0.02;   // noise and rounding are never outliers
constexpr double kMedianMemory = 0.95;  // of the running median, per step
constexpr double kMinNeighbors = 0.5;   // of an outlier that are outliers too
constexpr double kMinAlpha = 0.3;       // of a block that the map covers
constexpr double kMaxOutliers = 0.35;   // of a view; above, it does not fit yet
constexpr double kOutlierWeight = 0.02;

// Means over blocks of `size` pixels; those at the right and lower edge may have fewer.
Tensor block_means(const Tensor& images, std::int64_t size) {
  if (size == 1) return images;
  const auto options = F::AvgPool2dFuncOptions(size).ceil_mode(true).count_include_pad(false);
  return F::avg_pool2d(images.unsqueeze(0), options).squeeze(0);
}

// Sum of every three neighbors along a dimension.
Tensor sums_of_three(const Tensor& images, std::int64_t dimension) {
  const std::int64_t size = images.size(dimension) - 2;
  return images.narrow(dimension, 0, size) + images.narrow(dimension, 1, size) +
         images.narrow(dimension, 2, size);
}

// Means over 3 x 3 blocks; those at the edge count again beyond it. Faster than pooling on a CPU.
Tensor neighborhood_means(const Tensor& images) {
  const Tensor padded = torch::replication_pad2d(images.unsqueeze(0), {1, 1, 1, 1}).squeeze(0);
  return sums_of_three(sums_of_three(padded, 1), 2) / 9.0;
}

Tensor neighborhood_means_of(const Tensor& mask) {
  return neighborhood_means(mask.to(torch::kFloat32).unsqueeze(0)).squeeze(0);
}

// Side of a block [px].
std::int64_t block_size(const Tensor& image) {
  return std::max<std::int64_t>(1, std::max(image.size(0), image.size(1)) / kBlocks);
}

struct Blocks {
  Tensor residual;
  Tensor alpha;
};

Blocks blocks_of(const RobustWeights::Comparison& seen) {
  const Tensor rendered = seen.rendered.permute({2, 0, 1});
  const Tensor image = seen.image.permute({2, 0, 1});
  const Tensor difference = (rendered - image).abs().mean(0, true);
  const Tensor blocks = block_means(
      torch::cat({rendered, image, difference, seen.alpha.unsqueeze(0)}), block_size(seen.image));
  const Tensor means = neighborhood_means(blocks.narrow(0, 0, 7));
  const Tensor a = means.narrow(0, 0, 3) + kDark;
  const Tensor b = means.narrow(0, 3, 3) + kDark;
  const Tensor color = (a / a.sum(0, true) - b / b.sum(0, true)).abs().sum(0) * a.mean(0);
  return {.residual = means.select(0, 6) + kColorWeight * color, .alpha = blocks.select(0, 7)};
}

Tensor find_outliers(const Blocks& blocks, const Tensor& scale) {
  const Tensor median = torch::maximum(scale, blocks.residual.median());
  const Tensor high = blocks.residual > (kHigh * median).clamp_min(kMinResidual);
  const Tensor low = blocks.residual > (kLow * median).clamp_min(kMinResidual);
  Tensor outliers = high & (neighborhood_means_of(high) >= kMinNeighbors);
  for (int k = 0; k < kGrowth; ++k) outliers = low & (neighborhood_means_of(outliers) > 0.0);
  outliers = outliers & (blocks.alpha > kMinAlpha);
  return outliers & (outliers.to(torch::kFloat32).mean() < kMaxOutliers);
}

// From blocks to pixels [h,w], also of a larger image. Reducing crops incomplete blocks, which get
// zero.
Tensor at_pixels(const Tensor& blocks, std::int64_t height, std::int64_t width) {
  const std::int64_t size =
      std::max<std::int64_t>(1, (2 * height + blocks.size(0)) / (2 * blocks.size(0)));  // rounded
  const std::int64_t rows = blocks.size(0);
  const std::int64_t columns = blocks.size(1);
  const Tensor all = blocks.view({rows, 1, columns, 1})
                         .expand({rows, size, columns, size})
                         .reshape({rows * size, columns * size});
  const Tensor pixels =
      all.narrow(0, 0, std::min(height, all.size(0))).narrow(1, 0, std::min(width, all.size(1)));
  return torch::constant_pad_nd(pixels, {0, width - pixels.size(1), 0, height - pixels.size(0)});
}

std::string key(std::size_t view) {
  return "outliers" + std::to_string(view);
}

}  // namespace

void RobustWeights::add_view() {
  uses_.push_back(0);
  outliers_.emplace_back();
}

Tensor RobustWeights::weigh(std::size_t view, const Comparison& seen) {
  const torch::NoGradGuard no_grad;
  const std::int64_t use = uses_.at(view)++;
  if (use <= kMinUses || use % kInterval == 0) search(view, use, seen);
  const Tensor& outliers = outliers_[view];
  if (!outliers.defined()) return {};
  const Tensor lowered = at_pixels(outliers, seen.image.size(0), seen.image.size(1));
  return 1.0 - (1.0 - kOutlierWeight) * lowered.to(seen.rendered.scalar_type());
}

void RobustWeights::search(std::size_t view, std::int64_t use, const Comparison& seen) {
  const Blocks blocks = blocks_of(seen);
  const Tensor median = blocks.residual.median();
  scale_ = scale_.defined() ? kMedianMemory * scale_ + (1.0 - kMedianMemory) * median : median;
  if (use >= kMinUses) outliers_[view] = find_outliers(blocks, scale_);
}

Tensor RobustWeights::outliers(const Comparison& seen) const {
  const torch::NoGradGuard no_grad;
  if (!scale_.defined()) return torch::zeros_like(seen.alpha, torch::kBool);
  return at_pixels(find_outliers(blocks_of(seen), scale_), seen.image.size(0), seen.image.size(1));
}

Tensor RobustWeights::lowered(std::size_t view, std::int64_t height, std::int64_t width) const {
  const Tensor& blocks = outliers_.at(view);
  if (!blocks.defined()) return torch::zeros({height, width}, torch::kBool);
  return at_pixels(blocks, height, width);
}

void RobustWeights::save(torch::serialize::OutputArchive& archive) const {
  archive.write("uses", torch::tensor(uses_, torch::kInt64));
  if (scale_.defined()) archive.write("scale", scale_);
  for (std::size_t i = 0; i < outliers_.size(); ++i) {
    if (outliers_[i].defined()) archive.write(key(i), outliers_[i]);
  }
}

void RobustWeights::load(torch::serialize::InputArchive& archive) {
  Tensor uses;
  archive.read("uses", uses);
  uses_ = gaussians::host_values<std::int64_t>(uses);
  outliers_.assign(uses_.size(), Tensor());
  for (std::size_t i = 0; i < outliers_.size(); ++i) archive.try_read(key(i), outliers_[i]);
  scale_ = Tensor();
  archive.try_read("scale", scale_);
}

}  // namespace apvi::mapping
