// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>
#include <string_view>

#include "apvi/fusion/combine.hpp"
#include "apvi/fusion/dipo_stability.hpp"
#include "apvi/fusion/discriminator.hpp"
#include "apvi/fusion/freeze_policy.hpp"
#include "apvi/fusion/relative_filter.hpp"
#include "apvi/fusion/slew.hpp"

namespace apvi::fusion {

/// Where the pose of a frame comes from.
enum class FusionState {
  waiting,    ///< nothing has started; there is no pose
  fused,      ///< Eq. 7
  vio_only,   ///< the run has no DIPO
  dipo_only,  ///< VIO has not started, is starting anew, or just had a bad frame or too few good
              ///< ones
  frozen,     ///< VIO has failed, DIPO is stable
  dropped,    ///< VIO has failed, DIPO is not stable: odometry only
};
std::string_view to_string(FusionState state);

/// One camera frame. Poses of both subsystems are in one world (VIO starts in DIPO's), but for what
/// each has drifted; VIO's goes on over a freeze and a new start unless step 2 has no window.
struct FusionInput {
  Stamp stamp;
  std::optional<PoseEstimate> dipo;  ///< nothing: not in this run, or not started
  vio::FrameStatistics statistics;
  std::optional<VioEstimate> vio;  ///< nothing: not started, or no solution
  /// VIO's graph holds the DVL and the depth too: nothing of DIPO is left to fuse, and VIO goes on
  /// without vision. `consistent` then takes VIO's pose for as long as it does not contradict DIPO.
  bool vio_includes_dipo = false;
};

struct FusionResult {
  FusionState state = FusionState::waiting;
  std::optional<PoseEstimate> pose;  ///< none while waiting
  Verdict verdict;                   ///< of this frame alone, before hysteresis
  Stability dipo;
  std::optional<Eigenvalues> eigenvalues;  ///< as tested
  int directions = 0;                      ///< of VIO's pose that were used: 6 are all
  FreezePolicy::Decision freeze;
};

/// The reliability-aware fusion of the paper's section III-B for one frame after the other: judges
/// VIO (Algorithm 1) and DIPO, fuses (Eq. 7), and says what VIO's window must do. Pure logic on
/// numbers: no threads, no images. Not thread-safe.
class Fuser {
 public:
  Fuser(const Config& config, const FreezeConfig& freeze);

  /// What became of a DVL ping, as soon as it is known.
  void add(const dipo::Report& ping) { stability_.add(ping); }
  /// One frame; stamps must not go back. Never throws for what the subsystems say.
  FusionResult update(const FusionInput& given);

  const FreezePolicy& freeze_policy() const { return freeze_; }

 private:
  struct Pair {
    Stamp stamp;
    SE3 T_dipo;
    SE3 T_vio;
    Wander dipo_wander;
  };
  struct Judgement {
    Verdict verdict;
    std::optional<Eigenvalues> eigenvalues;
    WellConditioned directions;
  };

  Judgement judge(const FusionInput& input, const Stability& dipo) const;
  Verdict judge_agreement(const FusionInput& input, const Stability& dipo) const;
  void judge_degeneracy(const VioEstimate& vio, Judgement& result) const;
  enum class Source { none, dipo, vio, both };
  struct Target {
    PoseEstimate pose;
    Source source = Source::none;
  };

  bool vio_carries(const FusionInput& input, const FusionResult& result) const;
  // `used`: the directions of VIO's pose that enter; null: none.
  Target target(const FusionInput& input, const WellConditioned* used, bool vio_carries);
  Target fuse(const FusionInput& input, const WellConditioned* used);
  PoseEstimate output(const FusionInput& input, const Target& target, const Stability& dipo);
  std::optional<SE3> motion(const FusionInput& input, const Target& target,
                            const Stability& dipo) const;
  void remember(const FusionInput& input, bool used);

  Config config_;
  DipoStability stability_;
  Hysteresis hysteresis_;
  FreezePolicy freeze_;
  RelativeFilter relative_;
  Slew slew_;
  std::optional<FusionInput> last_;
  std::optional<PoseEstimate> last_dipo_;
  Wander dipo_wander_;  // since the start
  Target last_target_;
  std::deque<Pair> agreed_;  // what DIPO's motion is compared with: frames of the window of step 2
};

}  // namespace apvi::fusion
