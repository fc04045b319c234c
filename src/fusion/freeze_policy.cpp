// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/freeze_policy.hpp"

#include <array>

namespace apvi::fusion {
namespace {

constexpr std::array<std::string_view, 4> kPhases{"starting", "running", "frozen", "dropped"};
constexpr std::array<std::string_view, 4> kActions{"none", "freeze", "release", "reset"};

// A failure this long before the end should be over [s].
constexpr double kMinOutage_s = 1.0;

}  // namespace

std::string_view to_string(Phase phase) {
  return kPhases.at(static_cast<std::size_t>(phase));
}

std::string_view to_string(Action action) {
  return kActions.at(static_cast<std::size_t>(action));
}

bool Hysteresis::update(Stamp now, bool good) {
  const std::optional<double> contradicted_s = contradicted_.update(now, good != good_);
  if (contradicted_s && *contradicted_s >= (good ? config_.good_s : config_.bad_s)) set(good);
  return good_;
}

void Hysteresis::set(bool good) {
  good_ = good;
  contradicted_.reset();
}

FreezePolicy::Decision FreezePolicy::update(Stamp now, bool working, const Verdict& verdict,
                                            const Stability& dipo) {
  newest_ = now;
  track_features_back(now, verdict);
  // A short interruption of DIPO (saturated inertial samples) does not make it unstable.
  const bool interrupted = dipo.reason == StabilityReason::absent && has_dipo_;
  has_dipo_ = has_dipo_ || dipo.reason != StabilityReason::absent;
  accepted_.update(now, verdict.accepted());
  Decision decision;
  switch (phase_) {
    case Phase::starting:
      if (working) phase_ = Phase::running;
      break;
    case Phase::running:
      if (!working && !(interrupted && verdict.reason != Reason::diverged)) {
        decision = fail(now, verdict, dipo);
      }
      break;
    case Phase::frozen:
      decision = update_frozen(now, verdict, dipo);
      break;
    case Phase::dropped:
      if (may_return(now)) recover(now);
      break;
  }
  if (phase_ == Phase::frozen) ++counts_.freeze_frames;
  if (phase_ == Phase::dropped) ++counts_.drop_frames;
  decision.phase = phase_;
  return decision;
}

FreezePolicy::Decision FreezePolicy::fail(Stamp now, const Verdict& verdict,
                                          const Stability& dipo) {
  ++counts_.failures;
  accepted_.reset();
  outages_.push_back({.failed = now, .features_back = {}, .recovered = {}});
  track_features_back(now, verdict);
  if (verdict.reason == Reason::diverged) return reset("VIO has diverged");
  if (dipo.reason == StabilityReason::absent) {
    phase_ = Phase::dropped;  // without DIPO, re-initialization would not improve the estimate
    return {};
  }
  if (!dipo.stable()) return reset("DIPO is unstable");
  if (!config_.enabled) return reset("freezing is disabled");
  phase_ = Phase::frozen;
  return {.action = Action::freeze, .phase = phase_, .reason = to_string(verdict.reason)};
}

FreezePolicy::Decision FreezePolicy::update_frozen(Stamp now, const Verdict& verdict,
                                                   const Stability& dipo) {
  if (verdict.reason == Reason::diverged) return reset("VIO has diverged");
  if (!dipo.stable() && dipo.reason != StabilityReason::absent) return reset("DIPO is unstable");
  if (may_return(now)) {
    recover(now);
    return {.action = Action::release, .phase = phase_, .reason = "VIO recovered"};
  }
  const double frozen_s = seconds_between(outages_.back().failed, now);
  if (config_.max_frozen_s > 0.0 && frozen_s > config_.max_frozen_s)
    return reset("frozen too long");
  return {};
}

FreezePolicy::Decision FreezePolicy::reset(std::string_view reason) {
  phase_ = Phase::dropped;
  accepted_.reset();
  ++counts_.resets;
  return {.action = Action::reset, .phase = phase_, .reason = reason};
}

bool FreezePolicy::may_return(Stamp now) const {
  const std::optional<double> accepted_s = accepted_.elapsed(now);
  return accepted_s && *accepted_s >= config_.release_s;
}

void FreezePolicy::recover(Stamp now) {
  phase_ = Phase::running;
  outages_.back().recovered = now;
}

void FreezePolicy::track_features_back(Stamp now, const Verdict& verdict) {
  if (outages_.empty() || outages_.back().recovered) return;
  std::optional<Stamp>& back = outages_.back().features_back;
  if (verdict.reason == Reason::no_image || verdict.reason == Reason::too_few_features) {
    back.reset();
  } else if (!back) {
    back = now;
  }
}

bool FreezePolicy::recovered() const {
  if (outages_.empty() || outages_.back().recovered) return true;
  return seconds_between(outages_.back().failed, newest_) < kMinOutage_s;
}

std::vector<double> FreezePolicy::reinit_times() const {
  std::vector<double> times;
  for (const Outage& outage : outages_) {
    if (!outage.recovered) continue;
    times.push_back(
        seconds_between(outage.features_back.value_or(outage.failed), *outage.recovered));
  }
  return times;
}

}  // namespace apvi::fusion
