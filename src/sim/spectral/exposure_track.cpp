// SPDX-License-Identifier: BSD-3-Clause
#include "sim/spectral/exposure_track.hpp"

#include <algorithm>
#include <cmath>

#include "core/median.hpp"

namespace apvi::sim {
namespace {

// Moves `state` toward `goal` in `elapsed` seconds, on a logarithmic scale.
double follow(double state, double goal, double elapsed_s, double lag_s) {
  if (lag_s <= 0.0) return goal;
  return state * std::pow(goal / state, 1.0 - std::exp(-elapsed_s / lag_s));
}

double level(const Eigen::Vector3d& raw, const Development& development) {
  return Eigen::Vector3d(0.25, 0.5, 0.25).dot(raw.cwiseProduct(development.white_balance));
}

double clear_gain(const std::vector<Metering>& meterings, const Development& development,
                  double target_mean) {
  std::vector<double> levels;
  for (const Metering& metering : meterings)
    levels.push_back(level(metering.light.clear, development));
  return target_mean / std::max(1e-9, median(std::move(levels)));
}

double between(double a, double b, double part) {
  return a * std::pow(b / a, part);
}

}  // namespace

Development aim(const Eigen::Vector3d& raw, const CameraEffectsConfig& effects, WhiteBalance mode,
                const Eigen::Vector3d& fixed) {
  constexpr double kToGray = 0.85;
  Development goal{.gain = effects.gain, .white_balance = fixed};
  if (mode == WhiteBalance::automatic && !effects.white_balance) {
    for (int c : {0, 2})
      goal.white_balance[c] =
          std::clamp(std::pow(std::max(1e-9, raw.y()) / std::max(1e-9, raw[c]), kToGray), 0.4, 5.0);
    goal.white_balance.y() = 1.0;
  }
  if (effects.auto_gain) {
    goal.gain = std::min(effects.max_gain, effects.target_mean / std::max(1e-9, level(raw, goal)));
  }
  return goal;
}

ExposureTrack::ExposureTrack(const std::vector<Metering>& meterings,
                             const CameraEffectsConfig& effects, const SpectralConfig& spectral,
                             const Eigen::Vector3d& fixed) {
  Development state;
  for (const Metering& metering : meterings) {
    const Development goal =
        aim(metering.light.behind_lens, effects, spectral.white_balance, fixed);
    if (times_.empty()) state = goal;
    const double elapsed = times_.empty() ? 0.0 : metering.time_s - times_.back();
    state.gain = follow(state.gain, goal.gain, elapsed, spectral.exposure_lag_s);
    for (int c = 0; c < 3; ++c)
      state.white_balance[c] = follow(state.white_balance[c], goal.white_balance[c], elapsed,
                                      spectral.white_balance_lag_s);
    times_.push_back(metering.time_s);
    states_.push_back(state);
  }
  if (states_.empty()) return;
  clear_.white_balance = states_[states_.size() / 2].white_balance;
  clear_.gain = clear_gain(meterings, clear_, effects.target_mean);
}

Development ExposureTrack::at(double time_s) const {
  const auto after = std::upper_bound(times_.begin(), times_.end(), time_s);
  const auto high = std::clamp<std::ptrdiff_t>(after - times_.begin(), 0,
                                               static_cast<std::ptrdiff_t>(times_.size()) - 1);
  const auto low = std::max<std::ptrdiff_t>(0, high - 1);
  const auto i = static_cast<std::size_t>(low);
  const auto j = static_cast<std::size_t>(high);
  const double width = times_[j] - times_[i];
  const double part = width > 0.0 ? std::clamp((time_s - times_[i]) / width, 0.0, 1.0) : 0.0;
  Development result;
  result.gain = between(states_[i].gain, states_[j].gain, part);
  for (int c = 0; c < 3; ++c)
    result.white_balance[c] =
        between(states_[i].white_balance[c], states_[j].white_balance[c], part);
  return result;
}

}  // namespace apvi::sim
