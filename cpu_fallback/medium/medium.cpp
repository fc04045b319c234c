// SPDX-License-Identifier: BSD-3-Clause
#include <ATen/Parallel.h>
#include <torch/torch.h>

#include <array>
#include <vector>

#include "gaussians/render/splat_math.hpp"
#include "medium/medium_backend.hpp"

namespace apvi::medium {
namespace {

constexpr std::int64_t kRowsPerTask = 16;

template <typename T>
struct Pointers {
  std::int64_t width;
  std::int64_t height;
  const T* color;
  const T* depth;
  const T* alpha;
  const T* ray_lengths;  ///< or null
  std::array<gaussians::ChannelMedium<T>, 3> medium;
  gaussians::BackscatterTable<T> lamp_backscatter;

  explicit Pointers(const MediumInput& in)
      : width(in.color.size(1)),
        height(in.color.size(0)),
        color(in.color.data_ptr<T>()),
        depth(in.depth.data_ptr<T>()),
        alpha(in.alpha.data_ptr<T>()),
        ray_lengths(in.ray_lengths.defined() ? in.ray_lengths.data_ptr<T>() : nullptr),
        lamp_backscatter(backscatter_table<T>(in)) {
    for (std::size_t c = 0; c < 3; ++c) {
      medium[c] = {in.beta_d.data_ptr<T>()[c], in.beta_b.data_ptr<T>()[c],
                   in.b_inf.data_ptr<T>()[c]};
    }
  }

  T ray_length(std::int64_t i) const { return ray_lengths == nullptr ? T(1) : ray_lengths[i]; }
  gaussians::ChannelPixel<T> pixel(std::int64_t i, std::size_t c) const {
    return {color[3 * i + static_cast<std::int64_t>(c)], depth[i] * ray_length(i), alpha[i]};
  }
};

template <typename T>
void add_lamp_backscatter(const Pointers<T>& in, std::int64_t row, T* image) {
  const T y = (static_cast<T>(row) + T(0.5)) / static_cast<T>(in.height);
  for (std::int64_t column = 0; column < in.width; ++column) {
    const std::int64_t i = row * in.width + column;
    const T x = (static_cast<T>(column) + T(0.5)) / static_cast<T>(in.width);
    const T range = gaussians::backscatter_range(in.lamp_backscatter,
                                                 in.depth[i] * in.ray_length(i), in.alpha[i]);
    const gaussians::BackscatterPosition<T> place =
        gaussians::backscatter_position(in.lamp_backscatter, x, y, range);
    for (int c = 0; c < 3; ++c)
      image[3 * i + c] += gaussians::backscatter_at(in.lamp_backscatter, c, place);
  }
}

template <typename T>
void forward_rows(const Pointers<T>& in, std::int64_t begin, std::int64_t end, T* image) {
  for (std::int64_t i = begin * in.width; i < end * in.width; ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      image[3 * i + static_cast<std::int64_t>(c)] =
          gaussians::medium_forward(in.pixel(i, c), in.medium[c]);
    }
  }
  if (in.lamp_backscatter.values == nullptr) return;
  for (std::int64_t row = begin; row < end; ++row) add_lamp_backscatter(in, row, image);
}

/// Sums of one row, in double: the total does not depend on the distribution of rows to threads.
using RowSums = std::array<gaussians::ChannelMedium<double>, 3>;

template <typename T>
void backward_row(const Pointers<T>& in, const T* grad_image, std::int64_t row,
                  const MediumInput& out, RowSums& sums) {
  T* const grad_color = out.color.data_ptr<T>();
  T* const grad_depth = out.depth.data_ptr<T>();
  T* const grad_alpha = out.alpha.data_ptr<T>();
  for (std::int64_t i = row * in.width; i < (row + 1) * in.width; ++i) {
    T range_sum = 0;
    T alpha_sum = 0;
    for (std::size_t c = 0; c < 3; ++c) {
      const std::int64_t k = 3 * i + static_cast<std::int64_t>(c);
      const gaussians::ChannelGradient<T> g =
          gaussians::medium_backward(in.pixel(i, c), in.medium[c], grad_image[k]);
      grad_color[k] = g.pixel.color;
      range_sum += g.pixel.range;
      alpha_sum += g.pixel.alpha;
      sums[c].beta_d += static_cast<double>(g.medium.beta_d);
      sums[c].beta_b += static_cast<double>(g.medium.beta_b);
      sums[c].b_inf += static_cast<double>(g.medium.b_inf);
    }
    grad_depth[i] = range_sum * in.ray_length(i);
    grad_alpha[i] = alpha_sum;
  }
}

template <typename T>
void add_up(const std::vector<RowSums>& rows, MediumInput& out) {
  for (torch::Tensor* t : {&out.beta_d, &out.beta_b, &out.b_inf}) {
    *t = torch::empty({3}, out.color.options());
  }
  for (std::size_t c = 0; c < 3; ++c) {
    gaussians::ChannelMedium<double> total = {};
    for (const RowSums& row : rows) {
      total.beta_d += row[c].beta_d;
      total.beta_b += row[c].beta_b;
      total.b_inf += row[c].b_inf;
    }
    out.beta_d.data_ptr<T>()[c] = static_cast<T>(total.beta_d);
    out.beta_b.data_ptr<T>()[c] = static_cast<T>(total.beta_b);
    out.b_inf.data_ptr<T>()[c] = static_cast<T>(total.b_inf);
  }
}

class CpuMediumBackend final : public MediumBackend {
 public:
  std::string_view name() const override { return "cpu"; }

  torch::Tensor forward(const MediumInput& input) const override {
    torch::Tensor image = torch::empty_like(input.color);
    AT_DISPATCH_FLOATING_TYPES(input.color.scalar_type(), "medium_forward", [&] {
      const Pointers<scalar_t> in(input);
      auto* const out = image.data_ptr<scalar_t>();
      at::parallel_for(
          0, input.color.size(0), kRowsPerTask,
          [&](std::int64_t begin, std::int64_t end) { forward_rows(in, begin, end, out); });
    });
    return image;
  }

  MediumInput backward(const MediumInput& input, const torch::Tensor& grad_image,
                       bool with_medium_gradients) const override {
    MediumInput out = {.color = torch::empty_like(input.color),
                       .depth = torch::empty_like(input.depth),
                       .alpha = torch::empty_like(input.alpha),
                       .beta_d = {},
                       .beta_b = {},
                       .b_inf = {},
                       .ray_lengths = {},
                       .lamp_backscatter = {}};
    std::vector<RowSums> sums(static_cast<std::size_t>(input.color.size(0)), RowSums{});
    AT_DISPATCH_FLOATING_TYPES(input.color.scalar_type(), "medium_backward", [&] {
      const Pointers<scalar_t> in(input);
      const auto* const grad = grad_image.data_ptr<scalar_t>();
      at::parallel_for(0, input.color.size(0), kRowsPerTask,
                       [&](std::int64_t begin, std::int64_t end) {
                         for (std::int64_t row = begin; row < end; ++row) {
                           backward_row(in, grad, row, out, sums[static_cast<std::size_t>(row)]);
                         }
                       });
      if (with_medium_gradients) add_up<scalar_t>(sums, out);
    });
    return out;
  }
};

}  // namespace

const MediumBackend& cpu_medium_backend() {
  static const CpuMediumBackend backend;
  return backend;
}

}  // namespace apvi::medium
