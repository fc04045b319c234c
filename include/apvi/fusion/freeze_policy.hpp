// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <string_view>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/fusion/config.hpp"
#include "apvi/fusion/dipo_stability.hpp"
#include "apvi/fusion/discriminator.hpp"

namespace apvi::fusion {

/// Counts good and bad frames in a row before it changes its mind. Begins with bad.
class Hysteresis {
 public:
  explicit Hysteresis(const HysteresisConfig& config) : config_(config) {}
  /// Whether VIO counts as working after this frame.
  bool update(bool good);
  void set(bool good);
  bool good() const { return good_; }

 private:
  HysteresisConfig config_;
  bool good_ = false;
  int against_ = 0;  // frames in a row that contradict good_
};

/// What VIO's window is.
enum class Phase {
  starting,  ///< VIO has not worked yet
  running,
  frozen,   ///< DIPO supplies the poses, older ones and their points are held
  dropped,  ///< frames serve as odometry only; VIO starts anew
};
/// What VIO must do at this frame.
enum class Action { none, freeze, release, reset };
std::string_view to_string(Phase phase);
std::string_view to_string(Action action);

/// One time that VIO was away.
struct Outage {
  Stamp failed;
  std::optional<Stamp> features_back;  ///< since when there were corners enough, without a break
  std::optional<Stamp> recovered;
};

struct FreezeCounts {
  std::size_t freeze_frames = 0;
  std::size_t drop_frames = 0;
  std::size_t failures = 0;
  std::size_t resets = 0;
};

/// The sliding-window freezing strategy (paper, section III-B) as a machine of states, without the
/// window itself: says when to freeze it, to release it, to throw it away.
class FreezePolicy {
 public:
  explicit FreezePolicy(const FreezeConfig& config) : config_(config) {}

  struct Decision {
    Action action = Action::none;
    Phase phase = Phase::starting;
    std::string_view why;  ///< of the action; empty with none
  };
  /// One frame. `working`: VIO after hysteresis; `verdict`: of this frame alone.
  Decision update(Stamp now, bool working, const Verdict& verdict, const Stability& dipo);

  Phase phase() const { return phase_; }
  const FreezeCounts& counts() const { return counts_; }
  const std::vector<Outage>& outages() const { return outages_; }
  /// From the return of corners to the return of VIO, one per outage that is over [s].
  std::vector<double> reinit_times() const;

 private:
  Decision fail(Stamp now, const Verdict& verdict, const Stability& dipo);
  Decision while_frozen(Stamp now, const Verdict& verdict, const Stability& dipo);
  Decision reset(std::string_view why);
  void recover(Stamp now);
  void follow_features(Stamp now, const Verdict& verdict);

  FreezeConfig config_;
  Phase phase_ = Phase::starting;
  int good_in_a_row_ = 0;
  bool has_dipo_ = false;
  FreezeCounts counts_;
  std::vector<Outage> outages_;
};

}  // namespace apvi::fusion
