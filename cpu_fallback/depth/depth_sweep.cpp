// SPDX-License-Identifier: BSD-3-Clause
#include "cpu_fallback/depth/depth_sweep.hpp"

#include <ATen/Parallel.h>
#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <vector>

#include "cpu_fallback/depth/sweep_patch.hpp"

namespace apvi::depth::cpu {
namespace {

using torch::Tensor;

constexpr std::int64_t kBlocksPerTask = 64;
constexpr std::int64_t kRowsPerTask = 32;
constexpr std::int64_t kMinSide = 8;                // [px] minimum image size of a patch
constexpr float kIntensityScale = 255.0F * 256.0F;  // of intensity in a pyramid
constexpr float kMaxStep2 = 1.25F * 1.25F;  // [px²] between adjacent hypotheses in an image
constexpr float kDifferenceLimit = 32.0F * 256.0F;  // of PhotometricCost::absolute
constexpr float kMinDepthFactor = 1e-6F;

/// Downsamples by two; each pixel is the mean of four.
Tensor halved(const Tensor& pixels) {
  const std::int64_t height = pixels.size(0) / 2;
  const std::int64_t width = pixels.size(1) / 2;
  Tensor half = torch::empty({height, width}, pixels.options());
  const auto* const in = pixels.data_ptr<float>();
  auto* const out = half.data_ptr<float>();
  const std::int64_t stride = pixels.size(1);
  for (std::int64_t y = 0; y < height; ++y) {
    const float* const a = in + 2 * y * stride;
    const float* const b = a + stride;
    for (std::int64_t x = 0; x < width; ++x) {
      out[y * width + x] = 0.25F * (a[2 * x] + a[2 * x + 1] + b[2 * x] + b[2 * x + 1]);
    }
  }
  return half;
}

Tensor paired(const Tensor& pixels) {
  const std::int64_t height = pixels.size(0);
  const std::int64_t width = pixels.size(1);
  Tensor pairs = torch::empty({height, width}, torch::kInt32);
  const auto* const in = pixels.data_ptr<float>();
  auto* const out = pairs.data_ptr<std::int32_t>();
  for (std::int64_t y = 0; y < height; ++y) {
    const float* const a = in + y * width;
    const float* const b = in + std::min(y + 1, height - 1) * width;
    for (std::int64_t x = 0; x < width; ++x) {
      const auto low = static_cast<std::uint32_t>(std::lround(a[x]));
      const auto high = static_cast<std::uint32_t>(std::lround(b[x]));
      out[y * width + x] = static_cast<std::int32_t>(low | (high << 16U));
    }
  }
  return pairs;
}

using Pyramid = std::array<Level, kSweepLevels>;

/// Pyramid of an image with its number of levels.
struct View {
  Pyramid levels = {};
  int count = 0;

  explicit View(const Tensor* pyramid) {
    for (; count < kSweepLevels && pyramid[count].numel() > 0; ++count) {
      levels[static_cast<std::size_t>(count)] = {
          reinterpret_cast<const std::uint32_t*>(pyramid[count].data_ptr<std::int32_t>()),
          static_cast<int>(pyramid[count].size(1)), static_cast<int>(pyramid[count].size(0))};
    }
  }
};

/// A point of the reference with its patches, sampled on demand.
class Reference {
 public:
  Reference(const View& view, float x, float y, float noise, float sigma)
      : view_(view), x_(x), y_(y), noise_(noise), sigma_(sigma) {}

  struct Sample {
    Patch patch = {};
    float dx = 0.0F;  ///< [px] at full resolution: shift that keeps the patch inside the image
    float dy = 0.0F;
  };

  const Sample& at(int level) {
    const auto i = static_cast<std::size_t>(level);
    if (!taken_[i]) {
      samples_[i] = take(level);
      taken_[i] = true;
    }
    return samples_[i];
  }

 private:
  Sample take(int index) const {
    const Level& level = view_.levels[static_cast<std::size_t>(index)];
    const float scale = 1.0F / static_cast<float>(1 << index);
    const float x = scale * x_ - 0.5F;
    const float y = scale * y_ - 0.5F;
    constexpr float kEdge = kPatchReach + 0.01F;
    const float moved_x = std::clamp(x, kEdge, static_cast<float>(level.width - 1) - kEdge);
    const float moved_y = std::clamp(y, kEdge, static_cast<float>(level.height - 1) - kEdge);
    return {
        .patch = sample_patch(level, {moved_x, moved_y, 1.0F, 0.0F, 0.0F, 1.0F}, noise_, sigma_),
        .dx = (moved_x - x) / scale,
        .dy = (moved_y - y) / scale};
  }

  const View& view_;
  float x_;
  float y_;
  float noise_;
  float sigma_;
  std::array<Sample, kSweepLevels> samples_;
  std::array<bool, kSweepLevels> taken_ = {};
};

/// Epipolar line of a point in another image, parametrized by inverse depth.
struct EpipolarLine {
  std::array<float, 3> at_infinity = {};  ///< homogeneous pixel at infinity
  std::array<float, 3> translation = {};  ///< its derivative with respect to 1/depth
  std::array<float, 3> by_x = {};         ///< derivatives with respect to the reference pixel
  std::array<float, 3> by_y = {};

  EpipolarLine(const float* P, float x, float y) {
    for (std::size_t i = 0; i < 3; ++i, P += 4) {
      at_infinity[i] = P[0] * x + P[1] * y + P[2];
      translation[i] = P[3];
      by_x[i] = P[0];
      by_y[i] = P[1];
    }
  }

  /// Position at full resolution, with pixel centers at 0.5, and its derivatives.
  PatchTransform at(float inverse_depth, float slope_x, float slope_y) const {
    const float w = inverse_depth;
    const float inverse_z = 1.0F / depth_factor(w);
    const float x = (at_infinity[0] + w * translation[0]) * inverse_z;
    const float y = (at_infinity[1] + w * translation[1]) * inverse_z;
    const auto derivative = [&](const std::array<float, 3>& by, float slope, std::size_t i,
                                float place) {
      const float top = by[i] + w * slope * translation[i];
      const float bottom = by[2] + w * slope * translation[2];
      return (top - place * bottom) * inverse_z;
    };
    return {x,
            y,
            derivative(by_x, slope_x, 0, x),
            derivative(by_y, slope_y, 0, x),
            derivative(by_x, slope_x, 1, y),
            derivative(by_y, slope_y, 1, y)};
  }

  float depth_factor(float w) const { return at_infinity[2] + w * translation[2]; }
};

PatchTransform in_level(PatchTransform place, const Reference::Sample& sample, int level) {
  const float scale = 1.0F / static_cast<float>(1 << level);
  place.x = scale * (place.x + place.xx * sample.dx + place.xy * sample.dy) - 0.5F;
  place.y = scale * (place.y + place.yx * sample.dx + place.yy * sample.dy) - 0.5F;
  return place;
}

class Sweeper {
 public:
  Sweeper(const SweepImages& images, const SweepInput& input)
      : input_(input),
        points_(input.points.data_ptr<float>()),
        slopes_(input.slopes.data_ptr<float>()),
        levels_(input.levels.data_ptr<std::int32_t>()),
        projections_(input.projections.data_ptr<float>()),
        hypotheses_(input.inverse_depths.data_ptr<float>()),
        count_(input.inverse_depths.size(1)),
        hypothesis_stride_(input.inverse_depths.size(0) > 1 ? count_ : 0),
        noise_(static_cast<float>(input.noise) * kIntensityScale),
        sigma_(static_cast<float>(input.patch_sigma) * kIntensityScale) {
    for (std::size_t i = 0; i < images.pyramids.size(); i += kSweepLevels) {
      views_.emplace_back(&images.pyramids[i]);
    }
  }

  /// Costs [L] of one point and the number of observing images [L]. `costs` is scratch.
  void sweep(std::int64_t point, float* cost, std::uint8_t* seen, std::vector<float>& costs) const {
    const float x = points_[2 * point];
    const float y = points_[2 * point + 1];
    Reference reference(views_.front(), x, y, noise_, sigma_);
    costs.resize(static_cast<std::size_t>(count_) * views_.size());
    std::fill_n(seen, count_, std::uint8_t{0});
    for (std::size_t v = 1; v < views_.size(); ++v) {
      const EpipolarLine line(projections_ + 12 * (v - 1), x, y);
      add_view(point, line, v, reference, costs.data(), seen);
    }
    for (std::int64_t l = 0; l < count_; ++l) {
      cost[l] = mean_of_best(costs.data() + l * stride(), seen[l]);
    }
    fill_unobserved(cost, seen);
  }

 private:
  /// Row stride of the costs per hypothesis and view.
  std::int64_t stride() const { return static_cast<std::int64_t>(views_.size()); }

  /// Appends the costs of an image to each hypothesis.
  void add_view(std::int64_t point, const EpipolarLine& line, std::size_t v, Reference& reference,
                float* costs, std::uint8_t* seen) const {
    const float* const w = hypotheses_ + point * hypothesis_stride_;
    const float* const slope = slopes_ + 2 * point;
    const View& view = views_[v];
    const int coarsest = std::min(view.count, views_.front().count) - 1;
    const int finest = std::min(levels_[point], coarsest);
    for (std::int64_t l = 0; l < count_; ++l) {
      const float next = w[l + 1 < count_ ? l + 1 : std::max<std::int64_t>(l - 1, 0)];
      if (line.depth_factor(w[l]) < kMinDepthFactor || line.depth_factor(next) < kMinDepthFactor)
        continue;
      const PatchTransform place = line.at(w[l], slope[0], slope[1]);
      const PatchTransform neighbor = line.at(next, slope[0], slope[1]);
      const float step_x = neighbor.x - place.x;
      const float step_y = neighbor.y - place.y;
      const float step = step_x * step_x + step_y * step_y;
      int level = finest;
      while (level < coarsest && step > kMaxStep2 * static_cast<float>(1 << (2 * level))) {
        ++level;
      }
      const Reference::Sample& sample = reference.at(level);
      const PatchTransform where = in_level(place, sample, level);
      const Level& pixels = view.levels[static_cast<std::size_t>(level)];
      if (!inside(pixels, where)) continue;
      costs[l * stride() + seen[l]] = compare(point, v, w[l], sample.patch, pixels, where);
      ++seen[l];
    }
  }

  float compare(std::int64_t point, std::size_t v, float w, const Patch& patch, const Level& level,
                const PatchTransform& place) const {
    if (input_.cost == PhotometricCost::zncc) return correlation_cost(patch, level, place);
    const auto [gain, offset] = medium_transfer(point, v, w);
    return std::min(1.0F, difference_cost(patch, level, place, gain, offset) / kDifferenceLimit);
  }

  /// Affine intensity change from the reference to another camera through the medium: gain *
  /// intensity + offset.
  std::pair<float, float> medium_transfer(std::int64_t point, std::size_t v, float w) const {
    const GrayMedium& m = input_.medium;
    if (m.beta_d == 0.0 && m.beta_b == 0.0) return {1.0F, 0.0F};
    const auto* const K = input_.rays.data_ptr<float>();
    const auto* const center = input_.centers.data_ptr<float>() + 3 * (v - 1);
    double here = 0.0;
    double there = 0.0;
    for (std::int64_t i = 0; i < 3; ++i) {
      const double ray = static_cast<double>(K[3 * i] * points_[2 * point] +
                                             K[3 * i + 1] * points_[2 * point + 1] + K[3 * i + 2]) /
                         static_cast<double>(w);
      const double from_there = ray - static_cast<double>(center[i]);
      here += ray * ray;
      there += from_there * from_there;
    }
    here = std::sqrt(here);
    there = std::sqrt(there);
    const double gain = std::exp(m.beta_d * (here - there));
    const double backscatter_here = m.b_inf * (1.0 - std::exp(-m.beta_b * here));
    const double backscatter_there = m.b_inf * (1.0 - std::exp(-m.beta_b * there));
    return {static_cast<float>(gain),
            static_cast<float>(backscatter_there - gain * backscatter_here) * kIntensityScale};
  }

  float mean_of_best(float* costs, int seen) const {
    if (seen == 0) return 0.0F;
    const int counted = best_view_count(seen, input_.best_share);
    std::sort(costs, costs + seen);
    return std::accumulate(costs, costs + counted, 0.0F) / static_cast<float>(counted);
  }

  /// Hypotheses without observations get the mean cost of the others.
  void fill_unobserved(float* cost, const std::uint8_t* seen) const {
    double sum = 0.0;
    std::int64_t known = 0;
    for (std::int64_t l = 0; l < count_; ++l) {
      if (seen[l] == 0) continue;
      sum += static_cast<double>(cost[l]);
      ++known;
    }
    const float neutral = known > 0 ? static_cast<float>(sum / static_cast<double>(known)) : 1.0F;
    for (std::int64_t l = 0; l < count_; ++l) {
      if (seen[l] == 0) cost[l] = neutral;
    }
  }

  const SweepInput& input_;
  std::vector<View> views_;
  const float* points_;
  const float* slopes_;
  const std::int32_t* levels_;
  const float* projections_;
  const float* hypotheses_;
  std::int64_t count_;
  std::int64_t hypothesis_stride_;
  float noise_;
  float sigma_;
};

}  // namespace

SweepImages make_pyramids(const std::vector<Tensor>& grays) {
  SweepImages images;
  images.pyramids.resize(grays.size() * kSweepLevels);
  at::parallel_for(0, static_cast<std::int64_t>(grays.size()), 1,
                   [&](std::int64_t begin, std::int64_t end) {
                     for (std::int64_t v = begin; v < end; ++v) {
                       const auto first = static_cast<std::size_t>(v) * kSweepLevels;
                       Tensor pixels = grays[static_cast<std::size_t>(v)] * kIntensityScale;
                       for (std::size_t level = 0; level < kSweepLevels; ++level) {
                         if (std::min(pixels.size(0), pixels.size(1)) < kMinSide) break;
                         images.pyramids[first + level] = paired(pixels);
                         pixels = halved(pixels);
                       }
                     }
                   });
  for (Tensor& level : images.pyramids) {
    if (!level.defined()) level = torch::empty({0, 0}, torch::kInt32);
  }
  return images;
}

SweepOutput sweep(const SweepImages& images, const SweepInput& input) {
  const std::int64_t points = input.points.size(0);
  const std::int64_t count = input.inverse_depths.size(1);
  SweepOutput out = {.cost = torch::empty({points, count}, torch::kFloat32),
                     .views = torch::empty({points, count}, torch::kUInt8)};
  const Sweeper sweeper(images, input);
  auto* const cost = out.cost.data_ptr<float>();
  auto* const seen = out.views.data_ptr<std::uint8_t>();
  at::parallel_for(0, points, kBlocksPerTask, [&](std::int64_t begin, std::int64_t end) {
    std::vector<float> scratch;
    for (std::int64_t i = begin; i < end; ++i) {
      sweeper.sweep(i, cost + i * count, seen + i * count, scratch);
    }
  });
  return out;
}

}  // namespace apvi::depth::cpu
