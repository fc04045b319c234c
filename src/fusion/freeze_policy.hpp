// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <string_view>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/fusion/config.hpp"
#include "core/condition_timer.hpp"
#include "fusion/dipo_stability.hpp"
#include "fusion/discriminator.hpp"

namespace apvi::fusion {

/// Requires that consecutive frames are good or bad for some time before the state changes.
/// Initially bad.
class Hysteresis {
 public:
  explicit Hysteresis(const HysteresisConfig& config) : config_(config) {}
  /// Returns whether VIO is considered working after this frame.
  bool update(Stamp now, bool good);
  void set(bool good);
  bool good() const { return good_; }

 private:
  HysteresisConfig config_;
  bool good_ = false;
  ConditionTimer contradicted_;  // frames differ from good_
};

/// State of the VIO window.
enum class Phase {
  starting,  ///< VIO has not been accepted yet
  running,
  frozen,   ///< DIPO supplies the poses; older frames and landmarks are held fixed
  dropped,  ///< VIO re-initializes; odometry only
};
/// Command to VIO at this frame.
enum class Action { none, freeze, release, reset };
std::string_view to_string(Phase phase);
std::string_view to_string(Action action);

/// One outage of VIO.
struct Outage {
  Stamp failed;
  std::optional<Stamp>
      features_back;  ///< start of the current uninterrupted span with enough corners
  std::optional<Stamp> recovered;
};

struct FreezeCounts {
  std::size_t freeze_frames = 0;
  std::size_t drop_frames = 0;
  std::size_t failures = 0;
  std::size_t resets = 0;
};

/// The sliding-window freezing strategy (paper, section III-B) as a state machine that decides when
/// to freeze, release or reset the window.
class FreezePolicy {
 public:
  explicit FreezePolicy(const FreezeConfig& config) : config_(config) {}

  struct Decision {
    Action action = Action::none;
    Phase phase = Phase::starting;
    std::string_view reason;  ///< reason of the action; empty without one
  };
  /// Processes one frame. `working`: VIO after hysteresis; `verdict`: of this frame alone.
  Decision update(Stamp now, bool working, const Verdict& verdict, const Stability& dipo);

  Phase phase() const { return phase_; }
  const FreezeCounts& counts() const { return counts_; }
  const std::vector<Outage>& outages() const { return outages_; }
  /// Whether VIO recovered from every failure. One in the last second before the newest frame does
  /// not count, as a recording may end at any time.
  bool recovered() const;
  /// Time from the return of corners to the recovery of VIO, one per completed outage [s].
  std::vector<double> reinit_times() const;

 private:
  Decision fail(Stamp now, const Verdict& verdict, const Stability& dipo);
  Decision update_frozen(Stamp now, const Verdict& verdict, const Stability& dipo);
  Decision reset(std::string_view reason);
  bool may_return(Stamp now) const;
  void recover(Stamp now);
  void track_features_back(Stamp now, const Verdict& verdict);

  FreezeConfig config_;
  Phase phase_ = Phase::starting;
  ConditionTimer accepted_;  // frames are accepted
  bool has_dipo_ = false;
  Stamp newest_;  // of the frames
  FreezeCounts counts_;
  std::vector<Outage> outages_;
};

}  // namespace apvi::fusion
