// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>
#include <string_view>

#include "fusion/combine.hpp"
#include "fusion/dipo_stability.hpp"
#include "fusion/discriminator.hpp"
#include "fusion/freeze_policy.hpp"
#include "fusion/relative_filter.hpp"
#include "fusion/slew.hpp"

namespace apvi::fusion {

/// Source of the pose of a frame.
enum class FusionState {
  waiting,    ///< not initialized; no pose
  fused,      ///< Eq. 7
  vio_only,   ///< the run has no DIPO
  dipo_only,  ///< VIO is not initialized, or still in hysteresis after a bad frame
  frozen,     ///< VIO has failed, DIPO is stable; the window is frozen
  dropped,    ///< VIO has failed and DIPO is unstable: odometry only
};
std::string_view to_string(FusionState state);

/// One camera frame. The poses of both estimators are in one world (VIO is initialized in DIPO's),
/// apart from drift. VIO's pose is continuous across a freeze and a re-initialization unless step 2
/// has no window.
struct FusionInput {
  Stamp stamp;
  std::optional<PoseEstimate> dipo;  ///< nullopt: not in this run, or not initialized
  vio::FrameStatistics statistics;
  std::optional<VioEstimate> vio;  ///< nullopt: not initialized, or no solution
  /// VIO's graph includes DVL and pressure depth: DIPO adds no information, and VIO continues
  /// without vision. mode `consistent` then uses VIO's pose as long as it agrees with DIPO. Ignored
  /// with `bypass_for_tight_graph: false`.
  bool vio_includes_dipo = false;
};

struct FusionResult {
  FusionState state = FusionState::waiting;
  std::optional<PoseEstimate> pose;  ///< nullopt while waiting
  Verdict verdict;                   ///< before hysteresis
  Stability dipo;
  std::optional<Eigenvalues> eigenvalues;  ///< as tested
  int directions = 0;                      ///< number of directions of VIO's pose used, at most 6
  FreezePolicy::Decision freeze;
};

/// Reliability-aware fusion (paper, section III-B), frame by frame: validates VIO (Algorithm 1) and
/// DIPO, fuses them (Eq. 7), and controls the VIO window. Not thread-safe.
class Fuser {
 public:
  Fuser(const Config& config, const FreezeConfig& freeze);

  /// Reports the outcome of a DVL ping, as soon as it is known.
  void add(const dipo::Report& ping) { stability_.add(ping); }
  /// Processes one frame; stamps must not decrease. Never throws on invalid estimates.
  FusionResult update(const FusionInput& given);

  /// The vehicle moved unobserved: forgets poses, keeps the state of the freeze policy.
  void begin_segment();

  const FreezePolicy& freeze_policy() const { return freeze_; }

 private:
  struct PosePair {
    Stamp stamp;
    SE3 T_dipo;
    SE3 T_vio;
    DriftVariance dipo_drift;
  };
  struct Assessment {
    Verdict verdict;
    std::optional<Eigenvalues> eigenvalues;
    WellConditioned directions;
  };

  Assessment validate(const FusionInput& input, const Stability& dipo) const;
  Verdict validate_agreement(const FusionInput& input, const Stability& dipo) const;
  void validate_degeneracy(const VioEstimate& vio, Assessment& result) const;
  enum class Source { none, dipo, vio, both };
  struct Target {
    PoseEstimate pose;
    Source source = Source::none;
  };

  bool use_vio_directly(const FusionInput& input, const FusionResult& result) const;
  // `used`: directions of the VIO pose to fuse; null: none.
  Target target(const FusionInput& input, const WellConditioned* used, bool use_vio_directly);
  Target fuse(const FusionInput& input, const WellConditioned* used);
  PoseEstimate output(const FusionInput& input, const Target& target, const Stability& dipo);
  std::optional<SE3> motion(const FusionInput& input, const Target& target,
                            const Stability& dipo) const;
  void record(const FusionInput& input, bool used);

  Config config_;
  DipoStability stability_;
  Hysteresis hysteresis_;
  FreezePolicy freeze_;
  RelativeFilter relative_;
  Slew slew_;
  std::optional<FusionInput> last_;
  std::optional<PoseEstimate> last_dipo_;
  DriftVariance dipo_drift_;  // accumulated since the start
  Target last_target_;
  std::deque<PosePair> agreed_poses_;  // accepted frames within the window of step 2
};

}  // namespace apvi::fusion
