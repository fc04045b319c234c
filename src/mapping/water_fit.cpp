// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/water_fit.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::int64_t kFewestSightings = 300;
constexpr int kIterations = 30;
constexpr double kConverged = 1e-4;
constexpr double kLargestStep = 0.3;
constexpr double kLeastNoise = 0.003;    // of a colour: rounding to a byte, and a little more
constexpr double kTextureNoise = 0.5;    // of a colour's change around, by a patch that is off
constexpr double kInformation = 0.3;     // errors of neighbouring sightings are alike
constexpr double kGauge = 1e4;           // holds the mean of the gains
constexpr std::int64_t kPerChannel = 3;  // logs of beta_d, beta_b / beta_d and b_inf
constexpr std::int64_t kVignetting = 9;
constexpr std::int64_t kGains = 10;
const auto kF64 = torch::dtype(torch::kFloat64);

/// One channel of the model at the sightings.
struct Model {
  Tensor through;                      ///< what a point's colour is multiplied by
  Tensor veil;                         ///< what is added
  Tensor by_beta, by_ratio, by_b_inf;  ///< derivatives but for the colour's part of `by_beta`
  Tensor falloff;
};

class Solver {
 public:
  Solver(const Sightings& s, const WaterPrior& prior) : s_(s) {
    const auto n = kGains + s.view_count;
    mean_ = torch::zeros({n}, kF64);
    sigma_ = torch::full({n}, prior.gain_sigma, kF64);
    for (std::int64_t c = 0; c < 3; ++c) {
      const auto log_of = [c](const Tensor& t) { return t[c].to(torch::kFloat64).log(); };
      mean_[kPerChannel * c] = log_of(prior.medium.beta_d);
      mean_[kPerChannel * c + 2] = log_of(prior.medium.b_inf);
      sigma_[kPerChannel * c] = prior.beta_sigma;
      sigma_[kPerChannel * c + 1] = prior.ratio_sigma;
      sigma_[kPerChannel * c + 2] = prior.b_inf_sigma;
    }
    sigma_[kVignetting] = prior.vignetting_sigma;
    theta_ = mean_.clone();
  }

  void solve() {
    for (int i = 0; i < kIterations; ++i) {
      const auto [A, b] = normal_equations();
      const Tensor step = -std::get<0>(torch::linalg_solve_ex(A, b.unsqueeze(1)))
                               .squeeze(1)
                               .clamp(-kLargestStep, kLargestStep);
      theta_ += step;
      information_ = A;
      if (step.abs().max().item<double>() < kConverged) return;
    }
  }

  WaterFit result() const {
    const Tensor covariance = torch::inverse(information_);
    const Tensor logs = theta_.slice(0, 0, 9).reshape({3, 3});
    WaterFit fit;
    fit.medium.beta_d = logs.select(1, 0).exp();
    fit.medium.beta_b = (logs.select(1, 0) + logs.select(1, 1)).exp();
    fit.medium.b_inf = logs.select(1, 2).exp().clamp(1e-3, 0.98);
    fit.vignetting = std::clamp(theta_[kVignetting].item<double>(), 0.0, 0.9);
    fit.log_gains = theta_.slice(0, kGains).clone();
    fit.known = torch::empty({3, 3, 3}, kF64);
    fit.sigmas = torch::empty({3, 3}, kF64);
    // From (log beta_d, log ratio, log b_inf) to (log beta_d, log beta_b, log b_inf).
    const Tensor to_logs =
        torch::tensor({1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0}, kF64).reshape({3, 3});
    for (std::int64_t c = 0; c < 3; ++c) {
      const std::int64_t k = kPerChannel * c;
      const Tensor own = covariance.slice(0, k, k + 3).slice(1, k, k + 3);
      const Tensor prior = torch::diag(sigma_.slice(0, k, k + 3).square().reciprocal());
      const Tensor known = torch::eye(3, kF64) - own.mm(prior);
      fit.known[c].copy_(to_logs.mm(known).mm(torch::inverse(to_logs)));
      fit.sigmas[c].copy_(to_logs.mm(own).mm(to_logs.t()).diagonal().clamp_min(0.0).sqrt());
    }
    fit.noise = noise_.clone();
    return fit;
  }

 private:
  Model model(std::int64_t c) const {
    const Tensor p = theta_.slice(0, kPerChannel * c, kPerChannel * c + 3).exp();
    const Tensor beta_d = p[0];
    const Tensor beta_b = p[0] * p[1];
    const Tensor falloff = 1.0 - theta_[kVignetting] * s_.corners2;
    const Tensor g = theta_.slice(0, kGains).exp().index_select(0, s_.views);
    const Tensor direct = torch::exp(-beta_d * s_.ranges);
    const Tensor back = torch::exp(-beta_b * s_.ranges);
    const Tensor by_ratio = g * falloff * p[2] * beta_b * s_.ranges * back;
    return {.through = g * falloff * direct,
            .veil = g * falloff * p[2] * (1.0 - back),
            .by_beta = by_ratio,
            .by_ratio = by_ratio,
            .by_b_inf = g * falloff * p[2] * (1.0 - back),
            .falloff = falloff};
  }

  Tensor sum_by_point(const Tensor& values) const {
    std::vector<std::int64_t> shape = values.sizes().vec();
    shape[0] = s_.point_count;
    return torch::zeros(shape, kF64).index_add_(0, s_.points, values);
  }

  /// How much each sighting is trusted (Geman and McClure), with noise as large as the median says.
  Tensor weights(std::int64_t c, const Model& m, const Tensor& before) {
    const Tensor r = residual(c, m, colors(c, m, before));
    const Tensor sigma = (1.4826 * r.abs().median()).clamp_min(kLeastNoise);
    noise_[c] = sigma;
    const Tensor variance = sigma.square() + (kTextureNoise * s_.texture).square();
    return (1.0 + r.square() / (4.0 * variance)).square().reciprocal() / variance;
  }

  Tensor colors(std::int64_t c, const Model& m, const Tensor& w) const {
    const Tensor y = s_.colors.select(1, c) - m.veil;
    return sum_by_point(w * m.through * y) /
           sum_by_point(w * m.through * m.through).clamp_min(1e-12);
  }

  Tensor residual(std::int64_t c, const Model& m, const Tensor& J) const {
    return s_.colors.select(1, c) - m.veil - m.through * J.index_select(0, s_.points);
  }

  /// Information and gradient, the points' colours eliminated.
  std::pair<Tensor, Tensor> normal_equations() {
    const std::int64_t n = theta_.size(0);
    Tensor A = torch::diag(sigma_.square().reciprocal());
    Tensor b = (theta_ - mean_) / sigma_.square();
    for (std::int64_t c = 0; c < 3; ++c) {
      const Model m = model(c);
      Tensor& w = weights_[static_cast<std::size_t>(c)];
      if (!w.defined()) w = torch::ones_like(s_.ranges);
      w = weights(c, m, w);
      const Tensor J = colors(c, m, w);
      const Tensor r = residual(c, m, J);
      const Tensor lit = m.through * J.index_select(0, s_.points);  // what of the light is direct
      Tensor D = torch::zeros({r.size(0), n}, kF64);                // of the prediction
      const std::int64_t k = kPerChannel * c;
      const Tensor beta_d = theta_[k].exp();
      D.select(1, k).copy_(m.by_beta - lit * beta_d * s_.ranges);
      D.select(1, k + 1).copy_(m.by_ratio);
      D.select(1, k + 2).copy_(m.by_b_inf);
      D.select(1, kVignetting).copy_(-(lit + m.veil) * s_.corners2 / m.falloff);
      D.scatter_(1, (s_.views + kGains).unsqueeze(1), (lit + m.veil).unsqueeze(1));
      const Tensor wa = (w * m.through).unsqueeze(1);
      const Tensor mean =
          sum_by_point(wa * D) / sum_by_point(w * m.through.square()).clamp_min(1e-12).unsqueeze(1);
      const Tensor P = D - m.through.unsqueeze(1) * mean.index_select(0, s_.points);
      const Tensor weighted = w.unsqueeze(1) * P;
      A = A + kInformation * P.t().mm(weighted);
      b = b - kInformation * weighted.t().mv(r);
    }
    const auto views = static_cast<double>(s_.view_count);
    A.slice(0, kGains).slice(1, kGains).add_(kGauge / (views * views));
    b.slice(0, kGains).add_(kGauge / views * theta_.slice(0, kGains).mean());
    return {A, b};
  }

  const Sightings& s_;
  Tensor mean_, sigma_, theta_, information_;
  Tensor noise_ = torch::zeros({3}, kF64);
  std::array<Tensor, 3> weights_;
};

}  // namespace

std::optional<WaterFit> fit_water(const Sightings& sightings, const WaterPrior& prior) {
  if (!sightings.ranges.defined() || sightings.ranges.size(0) < kFewestSightings) {
    return std::nullopt;
  }
  const torch::NoGradGuard no_grad;
  Solver solver(sightings, prior);
  solver.solve();
  WaterFit fit = solver.result();
  const bool finite = torch::isfinite(fit.sigmas).all().item<bool>() &&
                      torch::isfinite(fit.log_gains).all().item<bool>() &&
                      torch::isfinite(fit.medium.beta_d).all().item<bool>();
  return finite ? std::optional(std::move(fit)) : std::nullopt;
}

}  // namespace apvi::mapping
