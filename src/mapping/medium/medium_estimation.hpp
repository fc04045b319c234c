// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "apvi/depth/options.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/medium/tone_curve_evidence.hpp"
#include "mapping/rendering.hpp"
#include "medium/medium_fit.hpp"

namespace apvi::mapping {

/// Medium and camera parameters estimated from a map and its keyframes.
struct MediumEstimation {
  std::vector<std::size_t> views;  ///< keyframes used, in the order of the fit's gains
  medium::MediumFit fit;
  bool sees_open_water = false;  ///< whether open water constrains b_inf
  /// By how much the medium lowers the deviance of the surfaces' colors; not known with a lamp,
  /// whose light needs the medium's model in any case.
  std::optional<double> saved_deviance = std::nullopt;
  std::int64_t observations = 0;         ///< of surfaces
  gaussians::ToneCurve tone_curve = {};  ///< of the camera, with which the fit was made
  ToneCurveEvidence evidence{{.kind = ToneCurveKind::linear}};
};

/// Observes surface points of the map in several keyframes at different ranges and fits the medium
/// to their colors. Colors are averaged over patches of constant size in the world; otherwise blur
/// that grows with range would be mistaken for attenuation. `spacing_m` is the minimum distance
/// between the keyframes used. With a lamp, depth is estimated from the images (`estimate_depth`
/// with these options). The tone curve is the choice of the `evidence`, to which these images are
/// added unless it is decided. Returns nothing if too few points have at least three observations.
std::optional<MediumEstimation> estimate_medium(
    const Map& map, const KeyframeStore& keyframes, double spacing_m, medium::MediumPrior prior,
    std::uint64_t seed, const depth::DepthOptions& depth = {},
    ToneCurveEvidence evidence = ToneCurveEvidence({.kind = ToneCurveKind::linear}));

}  // namespace apvi::mapping
