// SPDX-License-Identifier: BSD-3-Clause
#include <ATen/Parallel.h>
#include <torch/torch.h>

#include <algorithm>
#include <vector>

#include "cpu_fallback/loss/loss_kernel.hpp"
#include "gaussians/metrics/loss_backend.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

constexpr std::int64_t kRowsPerTask = 32;  // fewer would blur neighboring rows too often

template <typename T>
struct Images {
  std::int64_t height;
  std::int64_t length;
  const T* image;
  const T* target;
  Tensor weights;  ///< [H or 1, 3W]
  double values;   ///< number of valid values

  explicit Images(const LossInput& in)
      : height(in.image.size(0)),
        length(3 * in.image.size(1)),
        image(in.image.data_ptr<T>()),
        target(in.target.data_ptr<T>()) {
    if (in.valid.defined()) {
      weights = in.valid.unsqueeze(-1).expand({-1, -1, 3}).reshape({height, length});
      values = weights.sum(torch::kFloat64).item<double>();
    } else {
      weights = torch::ones({1, length}, in.image.options());
      values = static_cast<double>(height * length);
    }
  }

  cpu::LossRow<T> row(std::int64_t y) const {
    const T* const weight = weights.data_ptr<T>() + (weights.size(0) > 1 ? y * length : 0);
    return {image + y * length, target + y * length, weight, length};
  }
};

/// The rows around `y` from a buffer that holds row r at `place(r)`; zeros beyond the image.
template <typename T, typename Place>
cpu::Neighbors<T> neighbors(std::int64_t y, std::int64_t height, const T* zeros, Place row_at) {
  cpu::Neighbors<T> rows = {};
  for (std::int64_t t = 0; t < cpu::kSsimTaps; ++t) {
    const std::int64_t r = y + t - cpu::kSsimRadius;
    rows[static_cast<std::size_t>(t)] = r < 0 || r >= height ? zeros : row_at(r);
  }
  return rows;
}

/// Rows [begin, end), with a ring buffer of the eleven blurred rows that the next one needs.
template <typename T>
void compare_rows(const Images<T>& in, std::int64_t begin, std::int64_t end, T* saved,
                  std::vector<cpu::RowSums>& sums) {
  const std::int64_t row_size = cpu::kBlurred * in.length;
  std::vector<T> scratch(static_cast<std::size_t>(cpu::scratch_size(in.length)));
  std::vector<T> ring(static_cast<std::size_t>(cpu::kSsimTaps * row_size));
  const std::vector<T> zeros(static_cast<std::size_t>(row_size));
  const auto row_at = [&](std::int64_t r) { return ring.data() + (r % cpu::kSsimTaps) * row_size; };
  std::int64_t next = std::max<std::int64_t>(begin - cpu::kSsimRadius, 0);
  for (std::int64_t y = begin; y < end; ++y) {
    for (; next < std::min(y + cpu::kSsimRadius + 1, in.height); ++next) {
      cpu::blur_images(in.row(next), scratch.data(), row_at(next));
    }
    T* const derivatives = saved == nullptr ? nullptr : saved + y * cpu::kDerivatives * in.length;
    sums[static_cast<std::size_t>(y)] = cpu::compare(
        in.row(y), neighbors(y, in.height, zeros.data(), row_at), scratch.data(), derivatives);
  }
}

template <typename T>
double compare_images(const LossInput& input, T* saved) {
  const Images<T> in(input);
  std::vector<cpu::RowSums> rows(static_cast<std::size_t>(in.height), cpu::RowSums{});
  at::parallel_for(0, in.height, kRowsPerTask, [&](std::int64_t begin, std::int64_t end) {
    compare_rows(in, begin, end, saved, rows);
  });
  cpu::RowSums sums = {};
  for (const cpu::RowSums& row : rows) {
    sums.l1 += row.l1;
    sums.ssim += row.ssim;
  }
  if (in.values == 0.0) return 0.0;
  return (1.0 - input.ssim_weight) * sums.l1 / in.values +
         input.ssim_weight * (1.0 - sums.ssim / in.values);
}

template <typename T>
void differentiate_image(const LossInput& input, const T* saved, T* gradient) {
  const Images<T> in(input);
  const double inv_count = in.values == 0.0 ? 0.0 : 1.0 / in.values;
  const cpu::RowSums factors = {.l1 = (1.0 - input.ssim_weight) * inv_count,
                                .ssim = -input.ssim_weight * inv_count};
  const std::int64_t row_size = cpu::kDerivatives * in.length;
  const std::vector<T> zeros(static_cast<std::size_t>(row_size));
  const auto row_at = [&](std::int64_t r) { return saved + r * row_size; };
  at::parallel_for(0, in.height, kRowsPerTask, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t y = begin; y < end; ++y) {
      cpu::differentiate(in.row(y), neighbors(y, in.height, zeros.data(), row_at), factors,
                         gradient + y * in.length);
    }
  });
}

class CpuLossBackend final : public LossBackend {
 public:
  std::string_view name() const override { return "cpu"; }

  LossOutput forward(const LossInput& input, bool needs_backward) const override {
    const Tensor& image = input.image;
    LossOutput out = {.loss = torch::empty({}, image.options()), .saved = {}};
    if (needs_backward) {
      out.saved =
          torch::empty({image.size(0), cpu::kDerivatives, 3 * image.size(1)}, image.options());
    }
    AT_DISPATCH_FLOATING_TYPES(image.scalar_type(), "photometric_loss", [&] {
      scalar_t* const saved = needs_backward ? out.saved.data_ptr<scalar_t>() : nullptr;
      out.loss.fill_(compare_images<scalar_t>(input, saved));
    });
    return out;
  }

  Tensor backward(const LossInput& input, const Tensor& saved,
                  const Tensor& grad_loss) const override {
    Tensor gradient = torch::empty_like(input.image);
    AT_DISPATCH_FLOATING_TYPES(input.image.scalar_type(), "photometric_loss_backward", [&] {
      differentiate_image<scalar_t>(input, saved.data_ptr<scalar_t>(),
                                    gradient.data_ptr<scalar_t>());
    });
    return gradient.mul_(grad_loss);
  }
};

}  // namespace

const LossBackend& cpu_loss_backend() {
  static const CpuLossBackend backend;
  return backend;
}

}  // namespace apvi::gaussians
