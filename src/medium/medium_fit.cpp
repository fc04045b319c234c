// SPDX-License-Identifier: BSD-3-Clause
#include "medium/medium_fit.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "medium/medium_initialization.hpp"
#include "medium/medium_normal_equations.hpp"
#include "medium/medium_observation_model.hpp"

namespace apvi::medium {
namespace {

using torch::Tensor;

constexpr std::int64_t kMinObservations = 300;
constexpr int kIterations = 30;
constexpr double kStepTolerance = 1e-3;  // of logarithms; far below the bias of a fit
constexpr double kMaxStep = 0.3;
constexpr double kMeanGainPrecision = 1e4;  // fixes the gauge freedom of the gains
constexpr double kFixedSigma = 1e-3;        // of parameters that are fixed to the fused value
// Of a channel: the medium's parameters first, then those of the lamp.
constexpr std::int64_t kMediumParameters = 3;
constexpr std::int64_t kAttenuationParameters = 2;  // the first of these, fused over fits
constexpr double kNoMedium = 1e-6;  // attenuation [1/m] and light of a medium without effect
constexpr double kLampVeilingLight = 0.03;
constexpr double kLampVeilingLightSigma = 2.0;  // of its logarithm: 0.004 to 0.2
const auto kF64 = torch::dtype(torch::kFloat64);

/// Parameters: those of the medium by channel, those of the vignetting, the logarithms of the
/// views' gains.
class Solver {
 public:
  Solver(const Observations& observations, const MediumPrior& prior)
      : s_(sorted_by_point(observations)),
        model_(s_, prior),
        own_(model_.parameters()),
        equations_(s_, own_),
        vignetting_(3 * own_),
        gains_(vignetting_ + kVignettingParameters) {
    const auto n = gains_ + s_.view_count;
    mean_ = torch::zeros({n}, kF64);
    sigma_ = torch::full({n}, prior.gain_sigma, kF64);
    for (std::int64_t c = 0; c < 3; ++c) {
      mean_.slice(0, own_ * c, own_ * (c + 1)).copy_(model_.mean(c));
      sigma_.slice(0, own_ * c, own_ * (c + 1)).copy_(model_.sigma());
    }
    sigma_.slice(0, vignetting_, gains_).fill_(prior.vignetting_sigma);
    theta_ = mean_.clone();
    prior_information_ =
        torch::diag(model_.sigma().slice(0, 0, kMediumParameters).square().reciprocal());
  }

  void solve() {
    for (int i = 0; i < kIterations; ++i) {
      const auto [A, b] = normal_equations();
      const Tensor step = -std::get<0>(torch::linalg_solve_ex(A, b.unsqueeze(1)))
                               .squeeze(1)
                               .clamp(-kMaxStep, kMaxStep);
      theta_ += step;
      Tensor water = medium_parameters();
      model_.confine(water);
      confine_vignetting();
      information_ = A;
      if (step.abs().max().item<double>() < kStepTolerance) return;
    }
  }

  /// Adds the attenuation information of these observations, without the prior.
  void add_to(MediumPosterior& posterior) const {
    const Tensor prior =
        prior_information_.slice(0, 0, kAttenuationParameters).slice(1, 0, kAttenuationParameters);
    const Tensor found = medium_parameters().slice(1, 0, kAttenuationParameters);
    const Tensor covariance = torch::inverse(information_);
    Tensor information = torch::empty({3, kAttenuationParameters, kAttenuationParameters}, kF64);
    Tensor weighted = torch::empty({3, kAttenuationParameters}, kF64);
    for (std::int64_t c = 0; c < 3; ++c) {
      const Tensor all = torch::inverse(own(covariance, c, kAttenuationParameters));
      information[c].copy_(all - prior);
      weighted[c].copy_(all.mv(found[c]) - prior.mv(own(mean_, c, kAttenuationParameters)));
    }
    posterior.add(information, weighted, found);
  }

  /// Of each channel's medium parameters [3,3,3].
  Tensor covariances() const {
    const Tensor all = torch::inverse(information_);
    return torch::stack({own(all, 0, kMediumParameters), own(all, 1, kMediumParameters),
                         own(all, 2, kMediumParameters)});
  }

  /// Fixes attenuation to the fused posterior and updates `covariances` [3,3,3] accordingly.
  void condition_on(const MediumPosterior& posterior, Tensor& covariances) {
    const Tensor prior =
        prior_information_.slice(0, 0, kAttenuationParameters).slice(1, 0, kAttenuationParameters);
    for (std::int64_t c = 0; c < 3; ++c) {
      const Tensor shared = torch::inverse(prior + posterior.information()[c]);
      const Tensor mean = shared.mv(prior.mv(own(mean_, c, kAttenuationParameters)) +
                                    posterior.information_mean()[c]);
      own(mean_, c, kAttenuationParameters).copy_(mean);
      own(sigma_, c, kAttenuationParameters).fill_(kFixedSigma);
      own(theta_, c, kAttenuationParameters).copy_(mean);
      // b_inf keeps its correlation with attenuation (conditioning of a normal distribution).
      Tensor all = covariances[c];
      const Tensor before =
          all.slice(0, 0, kAttenuationParameters).slice(1, 0, kAttenuationParameters);
      const Tensor by = all.slice(0, kAttenuationParameters)
                            .slice(1, 0, kAttenuationParameters)
                            .mm(torch::inverse(before));
      const Tensor to = torch::cat({torch::eye(kAttenuationParameters, kF64), by});
      const Tensor change = to.mm(shared - before).mm(to.t());
      all += change;
    }
  }

  double deviance() const { return equations_.deviance(); }

  MediumFit result(const Tensor& covariances) const {
    MediumFit fit;
    fit.medium = model_.medium(medium_parameters());
    fit.vignetting = vignetting();
    fit.log_gains = theta_.slice(0, gains_).clone();
    fit.resolution = torch::empty({3, 3, 3}, kF64);
    fit.sigmas = torch::empty({3, 3}, kF64);
    // From (log beta_d, log ratio, log b_inf) to (log beta_d, log beta_b, log b_inf).
    const Tensor to_logs =
        torch::tensor({1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0}, kF64).reshape({3, 3});
    for (std::int64_t c = 0; c < 3; ++c) {
      const Tensor& own = covariances[c];
      const Tensor known = torch::eye(3, kF64) - own.mm(prior_information_);
      fit.resolution[c].copy_(to_logs.mm(known).mm(torch::inverse(to_logs)));
      fit.sigmas[c].copy_(to_logs.mm(own).mm(to_logs.t()).diagonal().clamp_min(0.0).sqrt());
    }
    fit.deviance = deviance();
    const std::array<double, 3>& noise = equations_.noise();
    fit.noise = torch::tensor({noise[0], noise[1], noise[2]}, kF64);
    return fit;
  }

 private:
  Tensor medium_parameters() const { return theta_.slice(0, 0, 3 * own_).view({3, own_}); }
  /// Segment or diagonal block of channel c in a vector or matrix of all parameters: its first
  /// `count` parameters.
  Tensor own(const Tensor& all, std::int64_t c, std::int64_t count) const {
    Tensor part = all.slice(0, own_ * c, own_ * c + count);
    return all.dim() == 1 ? part : part.slice(1, own_ * c, own_ * c + count);
  }
  Vignetting vignetting() const {
    return {.square = theta_[vignetting_].item<double>(),
            .fourth = theta_[vignetting_ + 1].item<double>()};
  }
  void confine_vignetting() {
    const Vignetting valid = vignetting().confined();
    theta_[vignetting_] = valid.square;
    theta_[vignetting_ + 1] = valid.fourth;
  }
  Tensor responses() const {
    return theta_.slice(0, gains_).exp().index_select(0, s_.views) *
           vignetting().factor(s_.corners2);
  }

  /// Information matrix and gradient, with the points' colors eliminated.
  std::pair<Tensor, Tensor> normal_equations() {
    const Tensor precision = sigma_.square().reciprocal();
    Tensor A = torch::diag(precision);
    Tensor b = precision * (theta_ - mean_);
    const std::vector<ChannelModel> models = model_.evaluate(medium_parameters(), responses());
    for (std::int64_t c = 0; c < 3; ++c) {
      equations_.add(c, models[static_cast<std::size_t>(c)], A, b);
    }
    const auto views = static_cast<double>(s_.view_count);
    A.slice(0, gains_).slice(1, gains_).add_(kMeanGainPrecision / (views * views));
    b.slice(0, gains_).add_(kMeanGainPrecision / views * theta_.slice(0, gains_).mean());
    return {A, b};
  }

  const Observations s_;  ///< sorted by point
  MediumObservationModel model_;
  std::int64_t own_;  ///< parameters per channel
  MediumNormalEquations equations_;
  std::int64_t vignetting_, gains_;
  Tensor mean_, sigma_, theta_, information_;
  Tensor prior_information_;  ///< [3,3] of a channel's medium parameters
};

}  // namespace

MediumPrior default_medium_prior(const std::vector<Lamp>& lamps, const MediumPosterior& posterior) {
  MediumPrior prior = {.medium = coastal_medium(), .lamps = lamps, .posterior = posterior};
  if (!lamps.empty()) {
    prior.medium.b_inf = torch::full({3}, kLampVeilingLight, kF64);
    prior.b_inf_sigma = kLampVeilingLightSigma;
  }
  return prior;
}

namespace {

// Veiling light is of the brightness of images, which the exposure control and the tone curve
// determine.
MediumPrior relative_to(const Observations& observations, MediumPrior prior) {
  constexpr double kUsualLight = 0.4;  // mean of linear images for which the prior is
  if (!prior.lamps.empty()) return prior;
  prior.medium.b_inf = prior.medium.b_inf * (observations.colors.mean() / kUsualLight);
  return prior;
}

}  // namespace

std::optional<MediumFit> fit_medium(const Observations& observations, const MediumPrior& prior) {
  if (!observations.ranges.defined() || observations.ranges.size(0) < kMinObservations) {
    return std::nullopt;
  }
  const torch::NoGradGuard no_grad;
  Solver solver(observations, relative_to(observations, prior));
  solver.solve();
  Tensor covariances = solver.covariances();
  if (!torch::isfinite(covariances).all().item<bool>()) return std::nullopt;
  MediumPosterior posterior = prior.posterior;
  solver.add_to(posterior);
  if (!prior.posterior.empty()) {
    solver.condition_on(posterior, covariances);
    solver.solve();
  }
  MediumFit fit = solver.result(covariances);
  fit.posterior = posterior;
  const bool finite = torch::isfinite(fit.sigmas).all().item<bool>() &&
                      torch::isfinite(fit.log_gains).all().item<bool>() &&
                      torch::isfinite(fit.medium.beta_d).all().item<bool>();
  return finite ? std::optional(std::move(fit)) : std::nullopt;
}

double deviance_without_medium(const Observations& observations, MediumPrior prior) {
  const torch::NoGradGuard no_grad;
  const Tensor none = torch::full({3}, kNoMedium, kF64);
  prior.medium = {.beta_d = none, .beta_b = none, .b_inf = none, .lamp = {}};
  prior.beta_sigma = prior.ratio_sigma = prior.b_inf_sigma = kFixedSigma;
  prior.lamp_backscatter = kNoMedium;
  prior.lamp_backscatter_sigma = kFixedSigma;
  Solver solver(observations, prior);
  solver.solve();
  return solver.deviance();
}

}  // namespace apvi::medium
