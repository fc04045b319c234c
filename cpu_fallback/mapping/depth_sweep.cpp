// SPDX-License-Identifier: BSD-3-Clause
#include "depth_sweep.hpp"

#include <ATen/Parallel.h>
#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <vector>

#include "sweep_patch.hpp"

namespace apvi::mapping::cpu {
namespace {

using torch::Tensor;

constexpr std::int64_t kBlocksPerTask = 64;
constexpr std::int64_t kRowsPerTask = 32;
constexpr std::int64_t kLeastSide = 8;              // [px] of a picture that a patch fits into
constexpr float kUnits = 255.0F * 256.0F;           // of intensity in a pyramid
constexpr float kLargestStep2 = 1.25F * 1.25F;      // [px²] between two hypotheses in one picture
constexpr float kDifferenceLimit = 32.0F * 256.0F;  // of PhotometricCost::absolute
constexpr float kBehind = 1e-6F;

/// Half the size, each pixel the mean of four.
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

/// A pyramid as kept, and how many of its levels there are.
struct View {
  Pyramid levels = {};
  int count = 0;

  explicit View(const Tensor* kept) {
    for (; count < kSweepLevels && kept[count].numel() > 0; ++count) {
      levels[static_cast<std::size_t>(count)] = {
          reinterpret_cast<const std::uint32_t*>(kept[count].data_ptr<std::int32_t>()),
          static_cast<int>(kept[count].size(1)), static_cast<int>(kept[count].size(0))};
    }
  }
};

/// A point of the reference with its patches, which are taken when they are first asked for.
class Reference {
 public:
  Reference(const View& view, float x, float y, float noise, float sigma)
      : view_(view), x_(x), y_(y), noise_(noise), sigma_(sigma) {}

  struct Sample {
    Patch patch = {};
    float dx = 0.0F;  ///< [px] of the whole picture: how far the patch was moved to lie in it
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
    return {.patch = take_patch(level, {moved_x, moved_y, 1.0F, 0.0F, 0.0F, 1.0F}, noise_, sigma_),
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

/// One point's way through one other picture.
struct Path {
  std::array<float, 3> fixed = {};   ///< homogeneous pixel at infinity
  std::array<float, 3> moving = {};  ///< what 1/depth adds to it
  std::array<float, 3> by_x = {};    ///< derivatives by the place in the reference
  std::array<float, 3> by_y = {};

  Path(const float* P, float x, float y) {
    for (std::size_t i = 0; i < 3; ++i, P += 4) {
      fixed[i] = P[0] * x + P[1] * y + P[2];
      moving[i] = P[3];
      by_x[i] = P[0];
      by_y[i] = P[1];
    }
  }

  /// Place in the whole picture, with pixel centres at 0.5, and its derivatives.
  PatchPlace at(float inverse_depth, float slope_x, float slope_y) const {
    const float w = inverse_depth;
    const float inverse_z = 1.0F / depth_factor(w);
    const float x = (fixed[0] + w * moving[0]) * inverse_z;
    const float y = (fixed[1] + w * moving[1]) * inverse_z;
    const auto derivative = [&](const std::array<float, 3>& by, float slope, std::size_t i,
                                float place) {
      const float top = by[i] + w * slope * moving[i];
      const float bottom = by[2] + w * slope * moving[2];
      return (top - place * bottom) * inverse_z;
    };
    return {x,
            y,
            derivative(by_x, slope_x, 0, x),
            derivative(by_y, slope_y, 0, x),
            derivative(by_x, slope_x, 1, y),
            derivative(by_y, slope_y, 1, y)};
  }

  float depth_factor(float w) const { return fixed[2] + w * moving[2]; }
};

PatchPlace in_level(PatchPlace place, const Reference::Sample& sample, int level) {
  const float scale = 1.0F / static_cast<float>(1 << level);
  place.x = scale * (place.x + place.xx * sample.dx + place.xy * sample.dy) - 0.5F;
  place.y = scale * (place.y + place.yx * sample.dx + place.yy * sample.dy) - 0.5F;
  return place;
}

class Sweeper {
 public:
  Sweeper(const SweepPictures& pictures, const SweepInput& input)
      : input_(input),
        points_(input.points.data_ptr<float>()),
        slopes_(input.slopes.data_ptr<float>()),
        levels_(input.levels.data_ptr<std::int32_t>()),
        projections_(input.projections.data_ptr<float>()),
        hypotheses_(input.inverse_depths.data_ptr<float>()),
        count_(input.inverse_depths.size(1)),
        hypothesis_stride_(input.inverse_depths.size(0) > 1 ? count_ : 0),
        noise_(static_cast<float>(input.noise) * kUnits),
        sigma_(static_cast<float>(input.patch_sigma) * kUnits) {
    for (std::size_t i = 0; i < pictures.kept.size(); i += kSweepLevels) {
      views_.emplace_back(&pictures.kept[i]);
    }
  }

  /// One point: costs [L], and how many pictures have seen it [L]. `costs` is scratch.
  void sweep(std::int64_t point, float* cost, std::uint8_t* seen, std::vector<float>& costs) const {
    const float x = points_[2 * point];
    const float y = points_[2 * point + 1];
    Reference reference(views_.front(), x, y, noise_, sigma_);
    costs.resize(static_cast<std::size_t>(count_) * views_.size());
    std::fill_n(seen, count_, std::uint8_t{0});
    for (std::size_t v = 1; v < views_.size(); ++v) {
      const Path path(projections_ + 12 * (v - 1), x, y);
      add_view(point, path, v, reference, costs.data(), seen);
    }
    for (std::int64_t l = 0; l < count_; ++l) {
      cost[l] = mean_of_best(costs.data() + l * stride(), seen[l]);
    }
    fill_unseen(cost, seen);
  }

 private:
  /// Of a hypothesis's row of costs, one a picture that sees it.
  std::int64_t stride() const { return static_cast<std::int64_t>(views_.size()); }

  /// Puts the picture's costs behind those of the pictures before it.
  void add_view(std::int64_t point, const Path& path, std::size_t v, Reference& reference,
                float* costs, std::uint8_t* seen) const {
    const float* const w = hypotheses_ + point * hypothesis_stride_;
    const float* const slope = slopes_ + 2 * point;
    const View& view = views_[v];
    const int coarsest = std::min(view.count, views_.front().count) - 1;
    const int finest = std::min(levels_[point], coarsest);
    for (std::int64_t l = 0; l < count_; ++l) {
      const float next = w[l + 1 < count_ ? l + 1 : std::max<std::int64_t>(l - 1, 0)];
      if (path.depth_factor(w[l]) < kBehind || path.depth_factor(next) < kBehind) continue;
      const PatchPlace place = path.at(w[l], slope[0], slope[1]);
      const PatchPlace neighbor = path.at(next, slope[0], slope[1]);
      const float step_x = neighbor.x - place.x;
      const float step_y = neighbor.y - place.y;
      const float step = step_x * step_x + step_y * step_y;
      int level = finest;
      while (level < coarsest && step > kLargestStep2 * static_cast<float>(1 << (2 * level))) {
        ++level;
      }
      const Reference::Sample& sample = reference.at(level);
      const PatchPlace where = in_level(place, sample, level);
      const Level& pixels = view.levels[static_cast<std::size_t>(level)];
      if (!inside(pixels, where)) continue;
      costs[l * stride() + seen[l]] = compare(point, v, w[l], sample.patch, pixels, where);
      ++seen[l];
    }
  }

  float compare(std::int64_t point, std::size_t v, float w, const Patch& patch, const Level& level,
                const PatchPlace& place) const {
    if (input_.cost == PhotometricCost::zncc) return correlation_cost(patch, level, place);
    const auto [gain, offset] = through_water(point, v, w);
    return std::min(1.0F, difference_cost(patch, level, place, gain, offset) / kDifferenceLimit);
  }

  /// What another camera sees of an intensity of the reference: gain * it + offset.
  std::pair<float, float> through_water(std::int64_t point, std::size_t v, float w) const {
    const GreyMedium& m = input_.medium;
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
    const double scattered_here = m.b_inf * (1.0 - std::exp(-m.beta_b * here));
    const double scattered_there = m.b_inf * (1.0 - std::exp(-m.beta_b * there));
    return {static_cast<float>(gain),
            static_cast<float>(scattered_there - gain * scattered_here) * kUnits};
  }

  float mean_of_best(float* costs, int seen) const {
    if (seen == 0) return 0.0F;
    const int counted = counted_views(seen, input_.best_share);
    std::sort(costs, costs + seen);
    return std::accumulate(costs, costs + counted, 0.0F) / static_cast<float>(counted);
  }

  /// A depth that no picture sees is as good as the mean of the others.
  void fill_unseen(float* cost, const std::uint8_t* seen) const {
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

SweepPictures make_pyramids(const std::vector<Tensor>& greys) {
  SweepPictures pictures;
  pictures.kept.resize(greys.size() * kSweepLevels);
  at::parallel_for(0, static_cast<std::int64_t>(greys.size()), 1,
                   [&](std::int64_t begin, std::int64_t end) {
                     for (std::int64_t v = begin; v < end; ++v) {
                       const auto first = static_cast<std::size_t>(v) * kSweepLevels;
                       Tensor pixels = greys[static_cast<std::size_t>(v)] * kUnits;
                       for (std::size_t level = 0; level < kSweepLevels; ++level) {
                         if (std::min(pixels.size(0), pixels.size(1)) < kLeastSide) break;
                         pictures.kept[first + level] = paired(pixels);
                         pixels = halved(pixels);
                       }
                     }
                   });
  for (Tensor& level : pictures.kept) {
    if (!level.defined()) level = torch::empty({0, 0}, torch::kInt32);
  }
  return pictures;
}

SweepOutput sweep(const SweepPictures& pictures, const SweepInput& input) {
  const std::int64_t points = input.points.size(0);
  const std::int64_t count = input.inverse_depths.size(1);
  SweepOutput out = {.cost = torch::empty({points, count}, torch::kFloat32),
                     .views = torch::empty({points, count}, torch::kUInt8)};
  const Sweeper sweeper(pictures, input);
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

}  // namespace apvi::mapping::cpu
