// SPDX-License-Identifier: BSD-3-Clause
#include <ATen/Parallel.h>
#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "cpu_fallback/depth/depth_sweep.hpp"

namespace apvi::depth::cpu {
namespace {

using torch::Tensor;

constexpr std::int64_t kLinesPerTask = 16;
constexpr std::int64_t kTable = 1024;
constexpr std::size_t kPlanes = 2;  // weighted values, and weights

/// exp(-difference / sigma) between neighbors, tabulated.
class Affinity {
 public:
  explicit Affinity(double sigma) : table_(kTable + 1) {
    for (std::size_t i = 0; i < table_.size(); ++i) {
      table_[i] = static_cast<float>(
          std::exp(-static_cast<double>(i) / static_cast<double>(kTable) / sigma));
    }
  }
  float operator()(float a, float b) const {
    const float difference = std::min(std::fabs(a - b), 1.0F);
    return table_[static_cast<std::size_t>(std::lround(difference * static_cast<float>(kTable)))];
  }

 private:
  std::vector<float> table_;
};

/// `count` parallel lines of `length` pixels: pixel i of line j is at i * along + j * across.
struct Lines {
  std::int64_t length;
  std::int64_t along;
  std::int64_t across;
};

/// Solves (1 + lambda A) u = f on lines [begin, end) in place, A the Laplacian of each line (Min et
/// al., Eq. 6 to 8: Thomas algorithm), with the lines of a task interleaved.
void solve(const Lines& lines, std::int64_t begin, std::int64_t end, float lambda,
           const Affinity& affinity, const float* guide, std::array<float*, kPlanes> planes) {
  const auto n = static_cast<std::size_t>(end - begin);
  std::vector<float> upper(static_cast<std::size_t>(lines.length) * n);
  std::vector<float> before(n, 0.0F);  // coupling to the previous pixel
  for (std::int64_t i = 0; i < lines.length; ++i) {
    for (std::size_t j = 0; j < n; ++j) {
      const std::int64_t p =
          i * lines.along + (begin + static_cast<std::int64_t>(j)) * lines.across;
      const float after =
          i + 1 < lines.length ? lambda * affinity(guide[p], guide[p + lines.along]) : 0.0F;
      float* const c = upper.data() + static_cast<std::size_t>(i) * n + j;
      const float above = i > 0 ? *(c - n) : 0.0F;
      const float inverse = 1.0F / (1.0F + before[j] + after - before[j] * above);
      *c = after * inverse;
      for (float* const plane : planes) {
        const float carried = i > 0 ? before[j] * plane[p - lines.along] : 0.0F;
        plane[p] = (plane[p] + carried) * inverse;
      }
      before[j] = after;
    }
  }
  for (std::int64_t i = lines.length - 1; i-- > 0;) {
    for (std::size_t j = 0; j < n; ++j) {
      const std::int64_t p =
          i * lines.along + (begin + static_cast<std::int64_t>(j)) * lines.across;
      const float c = upper[static_cast<std::size_t>(i) * n + j];
      for (float* const plane : planes) plane[p] += c * plane[p + lines.along];
    }
  }
}

}  // namespace

Tensor smooth(const SmoothInput& input) {
  const std::int64_t height = input.guide.size(0);
  const std::int64_t width = input.guide.size(1);
  Tensor out = torch::stack({input.values * input.weights, input.weights});
  const Affinity affinity(input.options.sigma);
  const auto* const guide = input.guide.data_ptr<float>();
  const std::array<float*, kPlanes> planes = {out[0].data_ptr<float>(), out[1].data_ptr<float>()};
  for (int round = 1; round <= input.options.iterations; ++round) {
    const float lambda = input.lambda(round);
    const Lines rows = {.length = width, .along = 1, .across = width};
    const Lines columns = {.length = height, .along = width, .across = 1};
    for (const auto& [lines, count] : {std::pair{rows, height}, {columns, width}}) {
      const Lines direction = lines;
      at::parallel_for(0, count, kLinesPerTask, [&](std::int64_t begin, std::int64_t end) {
        solve(direction, begin, end, lambda, affinity, guide, planes);
      });
    }
  }
  out[0].div_(out[1].clamp_min(1e-20));
  return out;
}

}  // namespace apvi::depth::cpu
