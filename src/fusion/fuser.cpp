// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/fuser.hpp"

#include <algorithm>
#include <array>
#include <utility>

namespace apvi::fusion {
namespace {

constexpr std::array<std::string_view, 6> kStates{"waiting",   "fused",  "vio_only",
                                                  "dipo_only", "frozen", "dropped"};

bool is_usable(const VioEstimate& vio) {
  return vio.healthy && is_finite(vio.T_world_body) && vio.information.allFinite() &&
         (!vio.window_information || vio.window_information->allFinite());
}

RelativeFilter::VioPose to_vio_pose(const VioEstimate& vio, const WellConditioned& directions) {
  RelativeFilter::VioPose seen{{vio.T_world_body, covariance_of(vio.information)}, {}, directions};
  if (vio.window_information && vio.window_s > 0.0) {
    seen.random_walk_per_s = covariance_of(*vio.window_information) / vio.window_s;
  }
  return seen;
}

FusionState state_of(const FusionResult& result, bool has_dipo, bool used) {
  if (used) return has_dipo ? FusionState::fused : FusionState::vio_only;
  if (!has_dipo) return FusionState::dropped;
  if (result.freeze.phase == Phase::frozen) return FusionState::frozen;
  return result.dipo.stable() ? FusionState::dipo_only : FusionState::dropped;
}

// Stability of the estimator that continues during a vision failure: DIPO, or a window that
// includes the sensors of DIPO and need not be re-initialized.
Stability carrier_stability(const FusionInput& input, const Stability& dipo) {
  return input.vio_includes_dipo && input.vio ? Stability{StabilityReason::stable} : dipo;
}

TrackingCheckConfig stricter_after_failure(TrackingCheckConfig config, double factor) {
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
  input.vio_includes_dipo = given.vio_includes_dipo && config_.bypass_for_tight_graph;
  FusionResult result;
  result.dipo = stability_.check(input.stamp, input.dipo);
  if (input.dipo && !is_finite(*input.dipo)) input.dipo.reset();
  if (input.dipo) {
    if (last_dipo_) dipo_drift_.add(*last_dipo_, *input.dipo);
    last_dipo_ = input.dipo;
  }
  const Assessment assessment = validate(input, result.dipo);
  result.verdict = assessment.verdict;
  result.eigenvalues = assessment.eigenvalues;
  if (input.vio && !is_usable(*input.vio)) input.vio.reset();

  if (result.verdict.reason == Reason::diverged) hysteresis_.set(false);
  const Phase before = freeze_.phase();
  const bool working = hysteresis_.update(input.stamp, result.verdict.accepted());
  result.freeze =
      freeze_.update(input.stamp, working, result.verdict, carrier_stability(input, result.dipo));
  if (has_returned(before, result.freeze.phase)) hysteresis_.set(true);

  const bool used = hysteresis_.good() && result.verdict.accepted();
  result.directions = used ? assessment.directions.directions() : 0;
  if (input.dipo || input.vio) {
    result.pose = output(
        input,
        target(input, used ? &assessment.directions : nullptr, use_vio_directly(input, result)),
        result.dipo);
  }
  if (result.pose) result.state = state_of(result, input.dipo.has_value(), used);
  record(input, used);
  return result;
}

void Fuser::begin_segment() {
  stability_ = DipoStability(config_.dipo_stability);
  relative_ = RelativeFilter(config_.relative);
  slew_ = Slew(config_.slew);
  last_.reset();
  last_dipo_.reset();
  dipo_drift_ = {};
  last_target_ = {};
  agreed_poses_.clear();
}

Fuser::Assessment Fuser::validate(const FusionInput& input, const Stability& dipo) const {
  Assessment result;
  const auto reject = [&result](const Verdict& verdict) {
    result.verdict = verdict;
    return !verdict.accepted();
  };
  if (input.vio && !is_usable(*input.vio)) {
    reject({Level::input, Reason::diverged});
    return result;
  }
  if (input.vio) {
    result.eigenvalues = tested_eigenvalues(*input.vio, config_.discriminator.degeneracy);
  }
  if (input.statistics.quality != vio::FrameQuality::good) {
    reject({Level::input, Reason::no_image, static_cast<double>(input.statistics.quality)});
    return result;
  }
  const TrackingCheckConfig& nominal = config_.discriminator.tracking;
  const bool failed = freeze_.phase() == Phase::frozen || freeze_.phase() == Phase::dropped;
  const TrackingCheckConfig asked =
      failed ? stricter_after_failure(nominal, config_.hysteresis.recovery_stable_ratio_factor)
             : nominal;
  if (reject(check_tracking(input.statistics, asked))) return result;
  if (!input.vio) {
    reject({Level::input, Reason::no_estimate});
    return result;
  }
  if (reject(validate_agreement(input, dipo))) return result;
  // A frozen window takes its poses from DIPO: its eigenvalues say nothing about vision.
  const bool frozen = freeze_.phase() == Phase::frozen;
  if (!frozen || input.vio_includes_dipo) validate_degeneracy(*input.vio, result);
  return result;
}

Verdict Fuser::validate_agreement(const FusionInput& input, const Stability& dipo) const {
  const AgreementCheckConfig& config = config_.discriminator.agreement;
  if (!input.dipo || (config.require_stable_dipo && !dipo.stable())) return {};
  SE3 T_vio = input.vio->T_world_body;
  AgreementCheckConfig limits = config;
  if (!agreed_poses_.empty()) {
    // After an outage longer than the window, compare with the last accepted pair.
    const Stamp oldest = input.stamp - Duration::from_seconds(config.window_s);
    const auto within = std::ranges::find_if(
        agreed_poses_, [&](const PosePair& pair) { return pair.stamp >= oldest; });
    const PosePair& then = within == agreed_poses_.end() ? agreed_poses_.back() : *within;
    T_vio = then.T_dipo * (then.T_vio.inverse() * T_vio);
    limits = widen_limits(config, dipo_drift_.since(then.dipo_drift));
  }
  return check_agreement(input.dipo->T_world_body, T_vio, limits);
}

void Fuser::validate_degeneracy(const VioEstimate& vio, Assessment& result) const {
  const DegeneracyCheckConfig& config = config_.discriminator.degeneracy;
  if (config.action == DegeneracyAction::ignore) return;
  const EigenThresholds thresholds{config.min_rotation_eigenvalue, config.min_position_eigenvalue};
  // With a DVL in the graph, the information stays high without vision. In a frozen window no
  // observation is used, so landmarks are not required.
  const bool tested = thresholds.rotation > 0.0 || thresholds.position > 0.0;
  if (tested && vio.inliers == 0 && freeze_.phase() != Phase::frozen) {
    result.verdict = {Level::fine, Reason::no_landmarks, 0.0, 1.0};
    return;
  }
  result.verdict = check_degeneracy(*result.eigenvalues, thresholds);
  if (result.verdict.accepted() || config.action == DegeneracyAction::reject) return;
  const bool normalized = config.normalization == Normalization::per_inlier;
  const double scale = normalized ? std::max(1, vio.inliers) : 1.0;
  WellConditioned kept =
      well_conditioned(vio.window_information.value_or(vio.information),
                       {scale * thresholds.rotation, scale * thresholds.position});
  if (kept.directions() < config.min_directions) return;
  result.verdict = {};
  result.directions = std::move(kept);
}

bool Fuser::use_vio_directly(const FusionInput& input, const FusionResult& result) const {
  if (config_.mode != Mode::consistent || !input.vio_includes_dipo || !input.vio) return false;
  return result.freeze.phase != Phase::dropped && result.verdict.level != Level::medium;
}

Fuser::Target Fuser::target(const FusionInput& input, const WellConditioned* used,
                            bool use_vio_directly) {
  if (input.dipo && !use_vio_directly) return fuse(input, used);
  return {{input.vio->T_world_body, covariance_of(input.vio->information)}, Source::vio};
}

Fuser::Target Fuser::fuse(const FusionInput& input, const WellConditioned* used) {
  const PoseEstimate& dipo = *input.dipo;
  if (config_.mode == Mode::consistent && config_.consistent_method == Consistent::relative) {
    std::optional<RelativeFilter::VioPose> seen;
    if (used != nullptr) seen = to_vio_pose(*input.vio, *used);
    relative_.step(input.stamp, dipo, seen);
    const PoseEstimate estimate = relative_.estimate();
    if (is_finite(estimate)) return {estimate, used != nullptr ? Source::both : Source::dipo};
    relative_ = RelativeFilter(config_.relative);  // singular covariance
    return {dipo, Source::dipo};
  }
  if (used == nullptr) return {dipo, Source::dipo};
  const Matrix6& projection = used->projection;
  const Matrix6 information = projection.transpose() * input.vio->information * projection;
  if (config_.mode == Mode::paper) {
    return {fuse_independent(dipo, input.vio->T_world_body, information), Source::both};
  }
  return {intersect_covariances(dipo, input.vio->T_world_body, information).estimate, Source::both};
}

PoseEstimate Fuser::output(const FusionInput& input, const Target& target, const Stability& dipo) {
  const double dt = last_ ? std::max(0.0, seconds_between(last_->stamp, input.stamp)) : 0.0;
  PoseEstimate pose = slew_.update(dt, motion(input, target, dipo), target.pose);
  last_target_ = target;
  return pose;
}

// The output follows the motion of its source; at a switch, the motion of the more trusted
// odometry.
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

void Fuser::record(const FusionInput& input, bool used) {
  last_ = input;
  const double window_s = config_.discriminator.agreement.window_s;
  // A window that includes the sensors of DIPO runs without vision; any other is recorded only if
  // accepted.
  const bool is_recorded = input.dipo && (used || (input.vio && input.vio_includes_dipo));
  if (!is_recorded || window_s == 0.0) return;
  agreed_poses_.push_back(
      {input.stamp, input.dipo->T_world_body, input.vio->T_world_body, dipo_drift_});
  const Stamp oldest = input.stamp - Duration::from_seconds(window_s);
  while (agreed_poses_.front().stamp < oldest) agreed_poses_.pop_front();
}

}  // namespace apvi::fusion
