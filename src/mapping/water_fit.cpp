// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/water_fit.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "apvi/splat/medium_estimate.hpp"
#include "water_equations.hpp"
#include "water_model.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::int64_t kFewestSightings = 300;
constexpr int kIterations = 30;
constexpr double kConverged = 1e-3;  // of logarithms: a thirtieth of what surveys err by
constexpr double kLargestStep = 0.3;
constexpr double kGauge = 1e4;       // holds the mean of the gains
constexpr double kHeld = 1e-3;       // sigma of what surveys have settled
constexpr std::int64_t kWater = 3;   // parameters of a channel's water; a lamp's are behind
constexpr std::int64_t kShared = 2;  // of these, those that surveys have in common
constexpr double kLamplitVeil = 0.03;
constexpr double kLamplitVeilSigma = 2.0;  // of its logarithm: 0.004 to 0.2
const auto kF64 = torch::dtype(torch::kFloat64);

/// Parameters: those of the water by channel, the vignetting, the logarithms of the views' gains.
class Solver {
 public:
  Solver(const Sightings& sightings, const WaterPrior& prior)
      : s_(by_point(sightings)),
        water_(s_, prior),
        own_(water_.parameters()),
        equations_(s_, own_),
        vignetting_(3 * own_),
        gains_(vignetting_ + 1) {
    const auto n = gains_ + s_.view_count;
    mean_ = torch::zeros({n}, kF64);
    sigma_ = torch::full({n}, prior.gain_sigma, kF64);
    for (std::int64_t c = 0; c < 3; ++c) {
      mean_.slice(0, own_ * c, own_ * (c + 1)).copy_(water_.mean(c));
      sigma_.slice(0, own_ * c, own_ * (c + 1)).copy_(water_.sigma());
    }
    sigma_[vignetting_] = prior.vignetting_sigma;
    theta_ = mean_.clone();
    before_ = torch::diag(water_.sigma().slice(0, 0, kWater).square().reciprocal());
  }

  void solve() {
    for (int i = 0; i < kIterations; ++i) {
      const auto [A, b] = normal_equations();
      const Tensor step = -std::get<0>(torch::linalg_solve_ex(A, b.unsqueeze(1)))
                               .squeeze(1)
                               .clamp(-kLargestStep, kLargestStep);
      theta_ += step;
      Tensor water = water_parameters();
      water_.confine(water);
      information_ = A;
      if (step.abs().max().item<double>() < kConverged) return;
    }
  }

  /// Adds what these sightings alone say of attenuation.
  void tell(WaterBelief& surveys) const {
    const Tensor prior = before_.slice(0, 0, kShared).slice(1, 0, kShared);
    const Tensor found = water_parameters().slice(1, 0, kShared);
    const Tensor covariance = torch::inverse(information_);
    Tensor information = torch::empty({3, kShared, kShared}, kF64);
    Tensor weighted = torch::empty({3, kShared}, kF64);
    for (std::int64_t c = 0; c < 3; ++c) {
      const Tensor all = torch::inverse(own(covariance, c, kShared));
      information[c].copy_(all - prior);
      weighted[c].copy_(all.mv(found[c]) - prior.mv(own(mean_, c, kShared)));
    }
    surveys.add(information, weighted, found);
  }

  /// Of each channel's water [3,3,3].
  Tensor covariances() const {
    const Tensor all = torch::inverse(information_);
    return torch::stack({own(all, 0, kWater), own(all, 1, kWater), own(all, 2, kWater)});
  }

  /// From now on attenuation is what surveys say together; brings `covariances` [3,3,3] up to it.
  void settle(const WaterBelief& surveys, Tensor& covariances) {
    const Tensor prior = before_.slice(0, 0, kShared).slice(1, 0, kShared);
    for (std::int64_t c = 0; c < 3; ++c) {
      const Tensor shared = torch::inverse(prior + surveys.information()[c]);
      const Tensor mean = shared.mv(prior.mv(own(mean_, c, kShared)) + surveys.weighted()[c]);
      own(mean_, c, kShared).copy_(mean);
      own(sigma_, c, kShared).fill_(kHeld);
      own(theta_, c, kShared).copy_(mean);
      // The veil's brightness goes with attenuation as it did (conditioning of a normal).
      Tensor all = covariances[c];
      const Tensor before = all.slice(0, 0, kShared).slice(1, 0, kShared);
      const Tensor by = all.slice(0, kShared).slice(1, 0, kShared).mm(torch::inverse(before));
      const Tensor to = torch::cat({torch::eye(kShared, kF64), by});
      const Tensor change = to.mm(shared - before).mm(to.t());
      all += change;
    }
  }

  WaterFit result(const Tensor& covariances) const {
    WaterFit fit;
    fit.medium = water_.medium(water_parameters());
    fit.vignetting = std::clamp(theta_[vignetting_].item<double>(), 0.0, 0.9);
    fit.log_gains = theta_.slice(0, gains_).clone();
    fit.known = torch::empty({3, 3, 3}, kF64);
    fit.sigmas = torch::empty({3, 3}, kF64);
    // From (log beta_d, log ratio, log b_inf) to (log beta_d, log beta_b, log b_inf).
    const Tensor to_logs =
        torch::tensor({1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0}, kF64).reshape({3, 3});
    for (std::int64_t c = 0; c < 3; ++c) {
      const Tensor& own = covariances[c];
      const Tensor known = torch::eye(3, kF64) - own.mm(before_);
      fit.known[c].copy_(to_logs.mm(known).mm(torch::inverse(to_logs)));
      fit.sigmas[c].copy_(to_logs.mm(own).mm(to_logs.t()).diagonal().clamp_min(0.0).sqrt());
    }
    const std::array<double, 3>& noise = equations_.noise();
    fit.noise = torch::tensor({noise[0], noise[1], noise[2]}, kF64);
    return fit;
  }

 private:
  Tensor water_parameters() const { return theta_.slice(0, 0, 3 * own_).view({3, own_}); }
  /// The part of a vector or matrix of all parameters that is of a channel's first `count`.
  Tensor own(const Tensor& all, std::int64_t c, std::int64_t count) const {
    Tensor part = all.slice(0, own_ * c, own_ * c + count);
    return all.dim() == 1 ? part : part.slice(1, own_ * c, own_ * c + count);
  }
  Tensor falloff() const { return 1.0 - theta_[vignetting_] * s_.corners2; }
  Tensor responses() const {
    return theta_.slice(0, gains_).exp().index_select(0, s_.views) * falloff();
  }

  /// Information and gradient, the points' colours eliminated.
  std::pair<Tensor, Tensor> normal_equations() {
    const Tensor precision = sigma_.square().reciprocal();
    Tensor A = torch::diag(precision);
    Tensor b = precision * (theta_ - mean_);
    const Tensor lens = falloff();
    const std::vector<ChannelModel> models = water_.evaluate(water_parameters(), responses());
    for (std::int64_t c = 0; c < 3; ++c) {
      equations_.add(c, models[static_cast<std::size_t>(c)], lens, A, b);
    }
    const auto views = static_cast<double>(s_.view_count);
    A.slice(0, gains_).slice(1, gains_).add_(kGauge / (views * views));
    b.slice(0, gains_).add_(kGauge / views * theta_.slice(0, gains_).mean());
    return {A, b};
  }

  const Sightings s_;  ///< by point
  WaterModel water_;
  std::int64_t own_;  ///< parameters of a channel
  WaterEquations equations_;
  std::int64_t vignetting_, gains_;
  Tensor mean_, sigma_, theta_, information_;
  Tensor before_;  ///< information [3,3] about a channel's water before anything was seen
};

}  // namespace

WaterPrior usual_prior(const std::optional<splat::Lamp>& lamp, const WaterBelief& surveys) {
  WaterPrior prior = {.medium = splat::coastal_medium(), .lamp = lamp, .surveys = surveys};
  if (lamp) {
    prior.medium.b_inf = torch::full({3}, kLamplitVeil, kF64);
    prior.b_inf_sigma = kLamplitVeilSigma;
  }
  return prior;
}

std::optional<WaterFit> fit_water(const Sightings& sightings, const WaterPrior& prior) {
  if (!sightings.ranges.defined() || sightings.ranges.size(0) < kFewestSightings) {
    return std::nullopt;
  }
  const torch::NoGradGuard no_grad;
  Solver solver(sightings, prior);
  solver.solve();
  Tensor covariances = solver.covariances();
  if (!torch::isfinite(covariances).all().item<bool>()) return std::nullopt;
  WaterBelief surveys = prior.surveys;
  solver.tell(surveys);
  if (!prior.surveys.empty()) {
    solver.settle(surveys, covariances);
    solver.solve();
  }
  WaterFit fit = solver.result(covariances);
  fit.surveys = surveys;
  const bool finite = torch::isfinite(fit.sigmas).all().item<bool>() &&
                      torch::isfinite(fit.log_gains).all().item<bool>() &&
                      torch::isfinite(fit.medium.beta_d).all().item<bool>();
  return finite ? std::optional(std::move(fit)) : std::nullopt;
}

}  // namespace apvi::mapping
