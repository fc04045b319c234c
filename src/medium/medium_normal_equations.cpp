// SPDX-License-Identifier: BSD-3-Clause
#include "medium/medium_normal_equations.hpp"

#include <ATen/Parallel.h>
#include <torch/torch.h>

#include <algorithm>
#include <tuple>

namespace apvi::medium {
namespace {

using torch::Tensor;
using Index = std::int64_t;

constexpr double kMinNoise = 0.003;         // of a color: 8-bit quantization plus a margin
constexpr double kTextureNoiseScale = 0.5;  // of the local color variation: patch misalignment
constexpr double kInformationScale =
    0.3;  // accounts for correlated errors of neighboring observations
constexpr double kMadToSigma = 1.4826;
constexpr Index kPartCount = 16;  // of the points, summed in parallel

/// Elements of a contiguous float64 tensor, which must outlive them; null where it is undefined.
const double* data_of(const Tensor& values) {
  if (!values.defined()) return nullptr;
  TORCH_CHECK(values.is_contiguous(), "medium: observations must be contiguous");
  return values.data_ptr<double>();
}

/// Geman-McClure's function of squared residuals in sigmas.
Tensor robust(const Tensor& square) {
  return square / (1.0 + square / 4.0);
}

}  // namespace

Observations sorted_by_point(const Observations& s) {
  const Tensor place = s.points * s.view_count + s.views;
  const Tensor order = std::get<1>(place.sort(/*stable=*/true, 0, /*descending=*/false));
  const auto sorted = [&order](const Tensor& t) {
    return t.defined() ? t.index_select(0, order) : Tensor();
  };
  return {.points = sorted(s.points),
          .views = sorted(s.views),
          .ranges = sorted(s.ranges),
          .corners2 = sorted(s.corners2),
          .colors = sorted(s.colors),
          .slopes = sorted(s.slopes),
          .texture = sorted(s.texture),
          .places = sorted(s.places),
          .normals = sorted(s.normals),
          .point_count = s.point_count,
          .view_count = s.view_count};
}

/// A channel's observations as raw arrays [n].
struct MediumNormalEquations::Channel {
  Index first_column;
  Tensor colors;  ///< minus the backscatter
  const double *seen, *direct, *backscatter, *weights;
  std::vector<const double*> direct_derivatives,
      backscatter_derivatives;  ///< by parameter; null: zero

  Channel(const Observations& s, Index column, Index c, const ChannelModel& model, const Tensor& w)
      : first_column(column),
        colors(s.colors.select(1, c) - model.backscatter),
        seen(data_of(colors)),
        direct(data_of(model.direct)),
        backscatter(data_of(model.backscatter)),
        weights(w.data_ptr<double>()) {
    for (const Tensor& part : model.direct_derivatives) direct_derivatives.push_back(data_of(part));
    for (const Tensor& part : model.backscatter_derivatives)
      backscatter_derivatives.push_back(data_of(part));
  }

  /// Of observation i by parameter k of the channel's own and the shared ones, for color J.
  double derivative(std::size_t k, Index i, double J) const {
    const double* const direct_by = direct_derivatives[k];
    const double* const backscatter_by = backscatter_derivatives[k];
    return (direct_by != nullptr ? J * direct_by[i] : 0.0) +
           (backscatter_by != nullptr ? backscatter_by[i] : 0.0);
  }

  /// Sum of w a^2 over the observations of a point, and the point's weighted least-squares color; 0
  /// instead of a negative one, which would explain too strong a backscatter.
  std::pair<double, double> color(Index begin, Index end) const {
    double aa = 0.0;
    double ay = 0.0;
    for (Index i = begin; i < end; ++i) {
      aa += weights[i] * direct[i] * direct[i];
      ay += weights[i] * direct[i] * seen[i];
    }
    aa = std::max(1e-12, aa);
    return {aa, std::max(0.0, ay / aa)};
  }
};

/// Upper triangle of the information matrix, and the gradient.
struct MediumNormalEquations::Sums {
  Tensor A, b;
  double *a, *gradient;
  Index size;

  explicit Sums(Index m)
      : A(torch::zeros({m, m}, torch::kFloat64)),
        b(torch::zeros({m}, torch::kFloat64)),
        a(A.data_ptr<double>()),
        gradient(b.data_ptr<double>()),
        size(m) {}

  /// Adds `scale` times the outer product of the sparse vector (`columns`, `values`) to the upper
  /// triangle. Columns are in ascending order.
  void add(double scale, const std::vector<Index>& columns, const std::vector<double>& values) {
    for (std::size_t k = 0; k < columns.size(); ++k) {
      double* const row = a + columns[k] * size;
      const double value = scale * values[k];
      for (std::size_t l = k; l < columns.size(); ++l) row[columns[l]] += value * values[l];
    }
  }
  void add_gradient(double scale, const std::vector<Index>& columns,
                    const std::vector<double>& values) {
    for (std::size_t k = 0; k < columns.size(); ++k) gradient[columns[k]] += scale * values[k];
  }
};

MediumNormalEquations::MediumNormalEquations(const Observations& observations,
                                             const MediumFitLayout& layout)
    : s_(observations), layout_(layout) {
  const Tensor ends = torch::bincount(s_.points, {}, s_.point_count).cumsum(0);
  first_.assign(ends.data_ptr<Index>(), ends.data_ptr<Index>() + ends.numel());
  first_.insert(first_.begin(), 0);
  for (std::size_t c = 0; c < 3; ++c) {
    weights_[c] = torch::ones_like(s_.ranges);
    slopes_[c] = s_.slopes.defined()
                     ? s_.slopes.select(1, static_cast<std::int64_t>(c)).contiguous()
                     : torch::ones_like(s_.ranges);
  }
}

/// Sum over i of w_i P_i P_i^T, where P_i = D_i - a_i g / s are the derivatives with the color
/// eliminated, g the sum of w_i a_i D_i and s that of w_i a_i^2. Equals the sum over w_i D_i D_i^T
/// minus g g^T / s. A color of 0 is at its limit: it is a constant, and nothing is eliminated.
void MediumNormalEquations::add_point(const Channel& channel, Index begin, Index end,
                                      Sums& sums) const {
  const auto own = static_cast<std::size_t>(layout_.own);
  const auto shared = static_cast<std::size_t>(layout_.own + layout_.shared);
  const auto [s, J] = channel.color(begin, end);
  const Index* views = s_.views.data_ptr<Index>();
  std::vector<Index> columns(shared + 1);
  for (std::size_t k = 0; k < own; ++k) columns[k] = channel.first_column + static_cast<Index>(k);
  for (std::size_t k = own; k < shared; ++k) {
    columns[k] = layout_.first_shared() + static_cast<Index>(k - own);
  }
  std::vector<double> D(shared + 1);
  std::vector<Index> all_columns(columns.begin(), columns.end() - 1);
  std::vector<double> g(shared, 0.0);
  for (Index i = begin; i < end; ++i) {
    const double w = kInformationScale * channel.weights[i];
    const double a = channel.direct[i];
    const double predicted = a * J + channel.backscatter[i];
    for (std::size_t k = 0; k < shared; ++k) D[k] = channel.derivative(k, i, J);
    D[shared] = predicted;  // by the logarithm of the view's gain
    columns[shared] = layout_.first_gain() + views[i];
    sums.add(w, columns, D);
    // The residual is orthogonal to a (or the color constant), so g does not contribute.
    sums.add_gradient(-w * (channel.seen[i] - a * J), columns, D);
    for (std::size_t k = 0; k < shared; ++k) g[k] += w * a * D[k];
    g.push_back(w * a * predicted);
    all_columns.push_back(columns[shared]);
  }
  if (J > 0.0) sums.add(-1.0 / (kInformationScale * s), all_columns, g);
}

void MediumNormalEquations::add_points(const Channel& channel, Index part, Sums& sums) const {
  const auto count = static_cast<Index>(first_.size()) - 1;
  const Index end = count * (part + 1) / kPartCount;
  for (Index p = count * part / kPartCount; p < end; ++p) {
    const Index* const first = &first_[static_cast<std::size_t>(p)];
    add_point(channel, first[0], first[1], sums);
  }
}

Tensor MediumNormalEquations::residuals(std::size_t c, const ChannelModel& model) const {
  const Channel channel(s_, 0, static_cast<Index>(c), model, weights_[c]);
  Tensor residual = channel.colors.clone();
  double* const x = residual.data_ptr<double>();
  for (std::size_t p = 0; p + 1 < first_.size(); ++p) {
    const double J = channel.color(first_[p], first_[p + 1]).second;
    for (Index i = first_[p]; i < first_[p + 1]; ++i) x[i] -= channel.direct[i] * J;
  }
  return residual.mul_(slopes_[c]);
}

Tensor MediumNormalEquations::variance(std::size_t c) const {
  return noise_[c] * noise_[c] + (kTextureNoiseScale * s_.texture).square();
}

void MediumNormalEquations::reweight(const std::vector<ChannelModel>& models, double min_noise) {
  for (std::size_t c = 0; c < 3; ++c) {
    const Tensor residual = residuals(c, models[c]);
    noise_[c] =
        std::max({kMinNoise, min_noise, kMadToSigma * residual.abs().median().item<double>()});
    const Tensor spread = variance(c);
    const Tensor square = residual.square() / spread;
    weights_[c] = (1.0 + square / 4.0).square().reciprocal() * slopes_[c].square() / spread;
    deviance_[c] = kInformationScale * (robust(square) + spread.log()).sum().item<double>();
  }
}

double MediumNormalEquations::cost(const std::vector<ChannelModel>& models) const {
  double sum = 0.0;
  for (std::size_t c = 0; c < 3; ++c) {
    const Tensor square = residuals(c, models[c]).square() / variance(c);
    sum += kInformationScale * robust(square).sum().item<double>();
  }
  return sum;
}

void MediumNormalEquations::add(const std::vector<ChannelModel>& models, Tensor& A,
                                Tensor& b) const {
  Tensor upper = torch::zeros_like(A);
  for (std::size_t c = 0; c < 3; ++c) {
    const auto number = static_cast<Index>(c);
    const Channel channel(s_, layout_.own * number, number, models[c], weights_[c]);
    // A fixed number of parts, so the sum does not depend on the number of threads.
    std::vector<Sums> parts;
    for (Index k = 0; k < kPartCount; ++k) parts.emplace_back(b.size(0));
    at::parallel_for(0, kPartCount, 1, [&](Index begin, Index end) {
      for (Index k = begin; k < end; ++k) {
        add_points(channel, k, parts[static_cast<std::size_t>(k)]);
      }
    });
    for (const Sums& part : parts) {
      upper += part.A;
      b += part.b;
    }
  }
  A += upper + upper.triu(1).t();
}

}  // namespace apvi::medium
