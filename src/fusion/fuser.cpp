// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/fusion/fuser.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <utility>

namespace apvi::fusion {
namespace {

constexpr std::array<std::string_view, 6> kStates{"waiting",   "fused",  "vio_only",
                                                  "dipo_only", "frozen", "dropped"};

// Information of a pose about which nothing is known, so that every information has an inverse.
Matrix6 covariance_of(const Matrix6& information) {
  constexpr double kUnknownTurn = 3.0;      // [rad]
  constexpr double kUnknownDistance = 1e3;  // [m]
  Vector6 ridge;
  ridge.head<3>().setConstant(1.0 / (kUnknownTurn * kUnknownTurn));
  ridge.tail<3>().setConstant(1.0 / (kUnknownDistance * kUnknownDistance));
  const Matrix6 sum = symmetric(information) + Matrix6(ridge.asDiagonal());
  return symmetric(sum.ldlt().solve(Matrix6::Identity()));
}

bool is_usable(const VioEstimate& vio) {
  return vio.healthy && is_finite(vio.T_world_body) && vio.information.allFinite() &&
         (!vio.window_information || vio.window_information->allFinite());
}

RelativeFilter::Seen seen_by(const VioEstimate& vio, const WellConditioned& directions) {
  RelativeFilter::Seen seen{{vio.T_world_body, covariance_of(vio.information)}, {}, directions};
  if (vio.window_information && vio.window_s > 0.0) {
    seen.walk_per_s = covariance_of(*vio.window_information) / vio.window_s;
  }
  return seen;
}

FusionState state_of(const FusionResult& result, bool has_dipo, bool used) {
  if (used) return has_dipo ? FusionState::fused : FusionState::vio_only;
  if (!has_dipo) return FusionState::dropped;
  if (result.freeze.phase == Phase::frozen) return FusionState::frozen;
  return result.dipo.stable() ? FusionState::dipo_only : FusionState::dropped;
}

// What carries a failed window: DIPO; one with DIPO's sensors in it carries itself, and starting
// anew it would know no more.
Stability carrier(const FusionInput& input, const Stability& dipo) {
  return input.vio_includes_dipo && input.vio ? Stability{StabilityReason::stable} : dipo;
}

CoarseConfig after_failure(CoarseConfig config, double factor) {
  config.min_stable_ratio = std::min(0.99, factor * config.min_stable_ratio);
  return config;
}

bool has_returned(Phase before, Phase now) {
  return now == Phase::running && (before == Phase::frozen || before == Phase::dropped);
}

}  // namespace

std::string_view to_string(FusionState state) {
  return kStates.at(static_cast<std::size_t>(state));
}

Fuser::Fuser(const Config& config, const FreezeConfig& freeze)
    : config_(config),
      stability_(config.dipo_stability),
      hysteresis_(config.hysteresis),
      freeze_(freeze),
      relative_(config.relative),
      slew_(config.slew) {}

FusionResult Fuser::update(const FusionInput& given) {
  FusionInput input = given;
  FusionResult result;
  result.dipo = stability_.check(input.stamp, input.dipo);
  if (input.dipo && !is_finite(*input.dipo)) input.dipo.reset();
  if (input.dipo) {
    if (last_dipo_) dipo_wander_.add(*last_dipo_, *input.dipo);
    last_dipo_ = input.dipo;
  }
  const Judgement judgement = judge(input, result.dipo);
  result.verdict = judgement.verdict;
  result.eigenvalues = judgement.eigenvalues;
  if (input.vio && !is_usable(*input.vio)) input.vio.reset();

  if (result.verdict.reason == Reason::diverged) hysteresis_.set(false);
  const Phase before = freeze_.phase();
  const bool working = hysteresis_.update(result.verdict.accepted());
  result.freeze = freeze_.update(input.stamp, working, result.verdict, carrier(input, result.dipo));
  if (has_returned(before, result.freeze.phase)) hysteresis_.set(true);

  const bool used = hysteresis_.good() && result.verdict.accepted();
  result.directions = used ? judgement.directions.directions() : 0;
  if (input.dipo || input.vio) {
    result.pose = output(
        input, target(input, used ? &judgement.directions : nullptr, vio_carries(input, result)),
        result.dipo);
  }
  if (result.pose) result.state = state_of(result, input.dipo.has_value(), used);
  remember(input, used);
  return result;
}

Fuser::Judgement Fuser::judge(const FusionInput& input, const Stability& dipo) const {
  Judgement result;
  const auto turn_down = [&result](const Verdict& verdict) {
    result.verdict = verdict;
    return !verdict.accepted();
  };
  if (input.vio && !is_usable(*input.vio)) {
    turn_down({Level::input, Reason::diverged});
    return result;
  }
  if (input.vio) {
    result.eigenvalues = tested_eigenvalues(*input.vio, config_.discriminator.fine);
  }
  if (input.statistics.quality != vio::FrameQuality::good) {
    turn_down({Level::input, Reason::no_image, static_cast<double>(input.statistics.quality)});
    return result;
  }
  const CoarseConfig& usual = config_.discriminator.coarse;
  const bool failed = freeze_.phase() == Phase::frozen || freeze_.phase() == Phase::dropped;
  const CoarseConfig asked =
      failed ? after_failure(usual, config_.hysteresis.return_factor) : usual;
  if (turn_down(coarse(input.statistics, asked))) return result;
  if (!input.vio) {
    turn_down({Level::input, Reason::no_estimate});
    return result;
  }
  if (turn_down(judge_agreement(input, dipo))) return result;
  // A frozen window leans on DIPO: how sure it is of itself says nothing about vision.
  const bool frozen = freeze_.phase() == Phase::frozen;
  if (!frozen || input.vio_includes_dipo) judge_degeneracy(*input.vio, result);
  return result;
}

Verdict Fuser::judge_agreement(const FusionInput& input, const Stability& dipo) const {
  const MediumConfig& config = config_.discriminator.medium;
  if (!input.dipo || (config.needs_stable_dipo && !dipo.stable())) return {};
  SE3 T_vio = input.vio->T_world_body;
  MediumConfig limits = config;
  if (!agreed_.empty()) {
    // After an outage longer than the window what counts is where both were last believed.
    const Stamp oldest = input.stamp - Duration::from_seconds(config.window_s);
    const auto within =
        std::ranges::find_if(agreed_, [&](const Pair& pair) { return pair.stamp >= oldest; });
    const Pair& then = within == agreed_.end() ? agreed_.back() : *within;
    T_vio = then.T_dipo * (then.T_vio.inverse() * T_vio);
    limits = widened(config, dipo_wander_.since(then.dipo_wander));
  }
  return medium(input.dipo->T_world_body, T_vio, limits);
}

void Fuser::judge_degeneracy(const VioEstimate& vio, Judgement& result) const {
  const FineConfig& config = config_.discriminator.fine;
  if (config.action == DegeneracyAction::ignore) return;
  const EigenThresholds thresholds{config.min_rotation, config.min_position};
  // With a DVL in its graph a window is sure of itself in the dark too. While it is frozen nothing
  // that is seen counts, so that there are no landmarks to ask for.
  const bool tested = thresholds.rotation > 0.0 || thresholds.position > 0.0;
  if (tested && vio.inliers == 0 && freeze_.phase() != Phase::frozen) {
    result.verdict = {Level::fine, Reason::no_landmarks, 0.0, 1.0};
    return;
  }
  result.verdict = fine(*result.eigenvalues, thresholds);
  if (result.verdict.accepted() || config.action == DegeneracyAction::reject) return;
  const bool normalised = config.normalisation == Normalisation::per_inlier;
  const double scale = normalised ? std::max(1, vio.inliers) : 1.0;
  WellConditioned kept =
      well_conditioned(vio.window_information.value_or(vio.information),
                       {scale * thresholds.rotation, scale * thresholds.position});
  if (kept.directions() < config.min_directions) return;
  result.verdict = {};
  result.directions = std::move(kept);
}

bool Fuser::vio_carries(const FusionInput& input, const FusionResult& result) const {
  if (config_.mode != Mode::consistent || !input.vio_includes_dipo || !input.vio) return false;
  return result.freeze.phase != Phase::dropped && result.verdict.level != Level::medium;
}

Fuser::Target Fuser::target(const FusionInput& input, const WellConditioned* used,
                            bool vio_carries) {
  if (input.dipo && !vio_carries) return fuse(input, used);
  return {{input.vio->T_world_body, covariance_of(input.vio->information)}, Source::vio};
}

Fuser::Target Fuser::fuse(const FusionInput& input, const WellConditioned* used) {
  const PoseEstimate& dipo = *input.dipo;
  if (config_.mode == Mode::consistent && config_.consistent == Consistent::relative) {
    std::optional<RelativeFilter::Seen> seen;
    if (used != nullptr) seen = seen_by(*input.vio, *used);
    relative_.step(input.stamp, dipo, seen);
    const PoseEstimate estimate = relative_.estimate();
    if (is_finite(estimate)) return {estimate, used != nullptr ? Source::both : Source::dipo};
    relative_ = RelativeFilter(config_.relative);  // a covariance of zero, or worse
    return {dipo, Source::dipo};
  }
  if (used == nullptr) return {dipo, Source::dipo};
  const Matrix6& projection = used->projection;
  const Matrix6 information = projection.transpose() * input.vio->information * projection;
  if (config_.mode == Mode::paper) {
    return {fuse_independent(dipo, input.vio->T_world_body, information), Source::both};
  }
  return {intersect(dipo, input.vio->T_world_body, information).estimate, Source::both};
}

PoseEstimate Fuser::output(const FusionInput& input, const Target& target, const Stability& dipo) {
  const double dt = last_ ? std::max(0.0, seconds_between(last_->stamp, input.stamp)) : 0.0;
  PoseEstimate pose = slew_.follow(dt, motion(input, target, dipo), target.pose);
  last_target_ = target;
  return pose;
}

// The output moves as its source does; at a switch, as the odometry that is trusted more.
std::optional<SE3> Fuser::motion(const FusionInput& input, const Target& target,
                                 const Stability& dipo) const {
  if (!last_ || last_target_.source == Source::none) return std::nullopt;
  if (target.source == last_target_.source) {
    return last_target_.pose.T_world_body.inverse() * target.pose.T_world_body;
  }
  std::optional<SE3> by_dipo;
  std::optional<SE3> by_vio;
  if (last_->dipo && input.dipo) {
    by_dipo = last_->dipo->T_world_body.inverse() * input.dipo->T_world_body;
  }
  if (last_->vio && input.vio) {
    by_vio = last_->vio->T_world_body.inverse() * input.vio->T_world_body;
  }
  return by_dipo && (dipo.stable() || !by_vio) ? by_dipo : by_vio;
}

void Fuser::remember(const FusionInput& input, bool used) {
  last_ = input;
  const double window_s = config_.discriminator.medium.window_s;
  // A window with DIPO's sensors in it goes on by itself; any other one is believed when it passes.
  const bool remembered = input.dipo && (used || (input.vio && input.vio_includes_dipo));
  if (!remembered || window_s == 0.0) return;
  agreed_.push_back({input.stamp, input.dipo->T_world_body, input.vio->T_world_body, dipo_wander_});
  const Stamp oldest = input.stamp - Duration::from_seconds(window_s);
  while (agreed_.front().stamp < oldest) agreed_.pop_front();
}

}  // namespace apvi::fusion
