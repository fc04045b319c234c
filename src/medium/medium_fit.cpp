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
constexpr int kIterations = 60;
constexpr double kStepTolerance = 1e-3;  // of logarithms; far below the bias of a fit
constexpr double kMaxStep = 1.0;
// Levenberg-Marquardt damping, relative to the diagonal.
constexpr double kInitialDamping = 1e-2;
constexpr double kDampingFactor = 5.0;
constexpr int kTrials = 6;
// Minimum noise at first, and its factor per iteration: outliers are told from a wrong start only
// when the fit is close (graduated non-convexity: Yang et al., RA-L 5 (2), 2020).
constexpr double kInitialNoise = 0.05;
constexpr double kNoiseFactor = 0.75;
constexpr double kMeanGainPrecision = 1e4;  // fixes the gauge freedom of the gains
constexpr double kFixedSigma = 1e-3;        // of parameters that are fixed to the fused value
// Of a channel: the medium's parameters first, then those of the lamp.
constexpr std::int64_t kMediumParameters = 3;
constexpr std::int64_t kAttenuationParameters = 2;  // the first of these, fused over fits
constexpr double kNoMedium = 1e-6;  // attenuation [1/m] and light of a medium without effect
constexpr double kLampVeilingLight = 0.03;
constexpr double kLampVeilingLightSigma = 2.0;  // of its logarithm: 0.004 to 0.2
const auto kF64 = torch::dtype(torch::kFloat64);

/// Minimizes the robust cost of the observations plus that of the prior.
class Solver {
 public:
  Solver(const Observations& observations, const MediumPrior& prior)
      : s_(sorted_by_point(observations)),
        model_(s_, prior),
        layout_(model_.layout()),
        equations_(s_, layout_),
        mean_(model_.mean()),
        sigma_(model_.sigma()),
        theta_(mean_.clone()) {
    const Tensor own = sigma_.slice(0, 0, kMediumParameters);
    prior_information_ = torch::diag(own.square().reciprocal());
  }

  void solve() {
    double min_noise = kInitialNoise;
    double damping = kInitialDamping;
    for (int i = 0; i < kIterations; ++i) {
      const auto models = model_.evaluate(theta_, /*with_derivatives=*/true);
      equations_.reweight(models, min_noise);
      const double step = improve(models, damping);
      const bool is_final = min_noise <= smallest_noise();
      min_noise *= kNoiseFactor;
      if (is_final && step < kStepTolerance) break;
    }
    const auto models = model_.evaluate(theta_, /*with_derivatives=*/true);
    equations_.reweight(models, 0.0);
    information_ = normal_equations(models).first;
  }

  /// Adds the attenuation information of these observations, without the prior.
  void add_to(MediumPosterior& posterior) const {
    const Tensor prior =
        prior_information_.slice(0, 0, kAttenuationParameters).slice(1, 0, kAttenuationParameters);
    const Tensor found = layout_.by_channel(theta_).slice(1, 0, kAttenuationParameters);
    const Tensor covariance = torch::inverse(information_);
    Tensor information = torch::empty({3, kAttenuationParameters, kAttenuationParameters}, kF64);
    Tensor weighted = torch::empty({3, kAttenuationParameters}, kF64);
    for (std::int64_t c = 0; c < 3; ++c) {
      const Tensor all = torch::inverse(of_channel(covariance, c, kAttenuationParameters));
      information[c].copy_(all - prior);
      weighted[c].copy_(all.mv(found[c]) - prior.mv(of_channel(mean_, c, kAttenuationParameters)));
    }
    posterior.add(information, weighted, found);
  }

  /// Of each channel's medium parameters [3,3,3].
  Tensor covariances() const {
    const Tensor all = torch::inverse(information_);
    return torch::stack({of_channel(all, 0, kMediumParameters),
                         of_channel(all, 1, kMediumParameters),
                         of_channel(all, 2, kMediumParameters)});
  }

  /// Fixes attenuation to the fused posterior and updates `covariances` [3,3,3] accordingly.
  void condition_on(const MediumPosterior& posterior, Tensor& covariances) {
    const Tensor prior =
        prior_information_.slice(0, 0, kAttenuationParameters).slice(1, 0, kAttenuationParameters);
    for (std::int64_t c = 0; c < 3; ++c) {
      const Tensor shared = torch::inverse(prior + posterior.information()[c]);
      const Tensor mean = shared.mv(prior.mv(of_channel(mean_, c, kAttenuationParameters)) +
                                    posterior.information_mean()[c]);
      of_channel(mean_, c, kAttenuationParameters).copy_(mean);
      of_channel(sigma_, c, kAttenuationParameters).fill_(kFixedSigma);
      of_channel(theta_, c, kAttenuationParameters).copy_(mean);
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
    fit.medium = model_.medium(theta_);
    fit.vignetting = model_.vignetting(theta_);
    fit.log_gains = theta_.slice(0, layout_.first_gain()).clone();
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
  /// Segment or diagonal block of channel c in a vector or matrix of all parameters: its first
  /// `count` parameters.
  Tensor of_channel(const Tensor& all, std::int64_t c, std::int64_t count) const {
    const std::int64_t first = layout_.own * c;
    Tensor part = all.slice(0, first, first + count);
    return all.dim() == 1 ? part : part.slice(1, first, first + count);
  }

  double smallest_noise() const {
    return *std::min_element(equations_.noise().begin(), equations_.noise().end());
  }

  /// Information matrix and gradient, with the points' colors eliminated.
  std::pair<Tensor, Tensor> normal_equations(const std::vector<ChannelModel>& models) const {
    const Tensor precision = sigma_.square().reciprocal();
    Tensor A = torch::diag(precision);
    Tensor b = precision * (theta_ - mean_);
    equations_.add(models, A, b);
    const auto views = static_cast<double>(layout_.views);
    const std::int64_t gains = layout_.first_gain();
    A.slice(0, gains).slice(1, gains).add_(kMeanGainPrecision / (views * views));
    b.slice(0, gains).add_(kMeanGainPrecision / views * theta_.slice(0, gains).mean());
    return {A, b};
  }

  double cost(const Tensor& theta, const std::vector<ChannelModel>& models) const {
    const double mean_gain = theta.slice(0, layout_.first_gain()).mean().item<double>();
    return equations_.cost(models) + ((theta - mean_) / sigma_).square().sum().item<double>() +
           kMeanGainPrecision * mean_gain * mean_gain;
  }

  /// One step that lowers the cost, if there is one; the largest change of a parameter, 0 if not.
  double improve(const std::vector<ChannelModel>& models, double& damping) {
    const double before = cost(theta_, models);
    const auto [A, b] = normal_equations(models);
    for (int i = 0; i < kTrials; ++i) {
      const Tensor damped = A + damping * torch::diag(A.diagonal());
      Tensor step = -std::get<0>(torch::linalg_solve_ex(damped, b.unsqueeze(1))).squeeze(1);
      const double largest = step.abs().max().item<double>();
      step *= std::min(1.0, kMaxStep / largest);
      Tensor next = theta_ + step;
      model_.confine(next);
      if (cost(next, model_.evaluate(next, /*with_derivatives=*/false)) < before) {
        const double change = (next - theta_).abs().max().item<double>();
        theta_ = next;
        damping /= kDampingFactor;
        return change;
      }
      damping *= kDampingFactor;
    }
    return 0.0;
  }

  const Observations s_;  ///< sorted by point
  MediumObservationModel model_;
  MediumFitLayout layout_;
  MediumNormalEquations equations_;
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
