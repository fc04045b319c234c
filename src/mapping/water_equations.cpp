// SPDX-License-Identifier: BSD-3-Clause
#include "water_equations.hpp"

#include <ATen/Parallel.h>
#include <torch/torch.h>

#include <algorithm>
#include <tuple>

namespace apvi::mapping {
namespace {

using torch::Tensor;
using Index = std::int64_t;

constexpr double kLeastNoise = 0.003;  // of a colour: rounding to a byte, and a little more
constexpr double kTextureNoise = 0.5;  // of a colour's change around, by a patch that is off
constexpr double kInformation = 0.3;   // errors of neighbouring sightings are alike
constexpr double kNormalMedian = 1.4826;
constexpr Index kParts = 16;  // of the points, summed side by side

/// Of a tensor float64, which must outlive them; none where it is undefined.
const double* numbers(const Tensor& values) {
  if (!values.defined()) return nullptr;
  TORCH_CHECK(values.is_contiguous(), "water: numbers must lie in a row");
  return values.data_ptr<double>();
}

}  // namespace

Sightings by_point(const Sightings& s) {
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
          .texture = sorted(s.texture),
          .places = sorted(s.places),
          .normals = sorted(s.normals),
          .point_count = s.point_count,
          .view_count = s.view_count};
}

/// A channel's sightings as plain numbers [n].
struct WaterEquations::Channel {
  Index first_column;
  Tensor colors;  ///< less the veil
  const double *seen, *through, *veil, *corners2, *falloff;
  double* weights;
  std::vector<const double*> through_by, veil_by;  ///< one a parameter; none: zero

  Channel(const Sightings& s, Index column, Index c, const ChannelModel& model, const Tensor& lens,
          const Tensor& w)
      : first_column(column),
        colors(s.colors.select(1, c) - model.veil),
        seen(numbers(colors)),
        through(numbers(model.through)),
        veil(numbers(model.veil)),
        corners2(numbers(s.corners2)),
        falloff(numbers(lens)),
        weights(w.data_ptr<double>()) {
    for (const Tensor& part : model.through_by) through_by.push_back(numbers(part));
    for (const Tensor& part : model.veil_by) veil_by.push_back(numbers(part));
  }

  /// Sum of w a^2 over the sightings of a point, and its colour by weighted least squares.
  std::pair<double, double> color(Index begin, Index end) const {
    double aa = 0.0;
    double ay = 0.0;
    for (Index i = begin; i < end; ++i) {
      aa += weights[i] * through[i] * through[i];
      ay += weights[i] * through[i] * seen[i];
    }
    aa = std::max(1e-12, aa);
    return {aa, ay / aa};
  }
};

/// The upper triangle of the information, and the gradient.
struct WaterEquations::Sums {
  Tensor A, b;
  double *a, *gradient;
  Index size;

  explicit Sums(Index m)
      : A(torch::zeros({m, m}, torch::kFloat64)),
        b(torch::zeros({m}, torch::kFloat64)),
        a(A.data_ptr<double>()),
        gradient(b.data_ptr<double>()),
        size(m) {}

  /// `scale` times the product of a column with itself and, for each, what it has with the others.
  /// The columns rise.
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

WaterEquations::WaterEquations(const Sightings& sightings, Index own) : s_(sightings), own_(own) {
  const Tensor ends = torch::bincount(s_.points, {}, s_.point_count).cumsum(0);
  first_.assign(ends.data_ptr<Index>(), ends.data_ptr<Index>() + ends.numel());
  first_.insert(first_.begin(), 0);
  for (Tensor& weights : weights_) weights = torch::ones_like(s_.ranges);
}

/// Sum over i of w_i P_i P_i^T, where P_i = D_i - a_i g / s are the derivatives with the colour
/// eliminated, g the sum of w_i a_i D_i and s that of w_i a_i^2: the sum over D_i less g g^T / s.
void WaterEquations::add_point(const Channel& channel, Index begin, Index end, Sums& sums) const {
  const auto shared = static_cast<std::size_t>(own_ + 1);
  const auto [s, J] = channel.color(begin, end);
  const Index* views = s_.views.data_ptr<Index>();
  std::vector<Index> columns(shared + 1);
  for (std::size_t k = 0; k + 1 < shared; ++k) {
    columns[k] = channel.first_column + static_cast<Index>(k);
  }
  columns[shared - 1] = 3 * own_;
  std::vector<double> D(shared + 1);
  std::vector<Index> all_columns(columns.begin(), columns.end() - 1);
  std::vector<double> g(shared, 0.0);
  for (Index i = begin; i < end; ++i) {
    const double w = kInformation * channel.weights[i];
    const double a = channel.through[i];
    const double looks = a * J + channel.veil[i];
    for (std::size_t k = 0; k + 1 < shared; ++k) {
      D[k] = (channel.through_by[k] != nullptr ? J * channel.through_by[k][i] : 0.0) +
             (channel.veil_by[k] != nullptr ? channel.veil_by[k][i] : 0.0);
    }
    D[shared - 1] = -looks * channel.corners2[i] / channel.falloff[i];
    D[shared] = looks;  // by the logarithm of the view's gain
    columns[shared] = 3 * own_ + 1 + views[i];
    sums.add(w, columns, D);
    // What is left is orthogonal to a, so that g has no part in the gradient.
    sums.add_gradient(-w * (channel.seen[i] - a * J), columns, D);
    for (std::size_t k = 0; k < shared; ++k) g[k] += w * a * D[k];
    g.push_back(w * a * looks);
    all_columns.push_back(columns[shared]);
  }
  sums.add(-1.0 / (kInformation * s), all_columns, g);
}

void WaterEquations::add_points(const Channel& channel, Index part, Sums& sums) const {
  const auto count = static_cast<Index>(first_.size()) - 1;
  const Index end = count * (part + 1) / kParts;
  for (Index p = count * part / kParts; p < end; ++p) {
    const Index* const first = &first_[static_cast<std::size_t>(p)];
    add_point(channel, first[0], first[1], sums);
  }
}

void WaterEquations::add(Index c, const ChannelModel& model, const Tensor& falloff, Tensor& A,
                         Tensor& b) {
  const auto number = static_cast<std::size_t>(c);
  Tensor& weights = weights_[number];
  const Channel channel(s_, own_ * c, c, model, falloff, weights);
  Tensor left = channel.colors.clone();
  for (std::size_t p = 0; p + 1 < first_.size(); ++p) {
    const double J = channel.color(first_[p], first_[p + 1]).second;
    for (Index i = first_[p]; i < first_[p + 1]; ++i) {
      left.data_ptr<double>()[i] -= channel.through[i] * J;
    }
  }
  const double sigma = std::max(kLeastNoise, kNormalMedian * left.abs().median().item<double>());
  noise_[number] = sigma;
  // Geman and McClure
  const Tensor variance = sigma * sigma + (kTextureNoise * s_.texture).square();
  weights.copy_((1.0 + left.square() / (4.0 * variance)).square().reciprocal() / variance);
  // Parts that do not depend on how many threads there are, nor does then their sum.
  std::vector<Sums> parts;
  for (Index k = 0; k < kParts; ++k) parts.emplace_back(b.size(0));
  at::parallel_for(0, kParts, 1, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k) add_points(channel, k, parts[static_cast<std::size_t>(k)]);
  });
  Tensor upper = torch::zeros_like(A);
  for (const Sums& part : parts) {
    upper += part.A;
    b += part.b;
  }
  A += upper + upper.triu(1).t();
}

}  // namespace apvi::mapping
