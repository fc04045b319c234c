// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <optional>

#include "gaussians/model/gaussians.hpp"
#include "gaussians/render/tone_curve.hpp"
#include "gaussians/render/view.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "medium/medium.hpp"
#include "medium/vignetting.hpp"

namespace apvi::mapping {

/// A map with its medium and camera response. Colors are in linear light.
struct Map {
  gaussians::Gaussians gaussians;
  std::optional<medium::Medium> medium;
  /// [3] color of the light of this session, by which surfaces are brighter than in the session
  /// that the colors of the Gaussians are for; undefined: the same light.
  torch::Tensor light = {};
  bool antialiased = false;  ///< as it was trained
  /// [n] log gains of the keyframes: brightness of their images relative to the map; undefined: all
  /// equal.
  torch::Tensor log_gains = {};
  /// [n,3,rows,columns] logarithms of the fields of gains of the keyframes, of image values
  /// (mapping::Illumination); undefined: none.
  torch::Tensor illumination = {};
  medium::Vignetting vignetting = {};
  gaussians::ToneCurve tone_curve = {};  ///< of the camera, which makes image values of light
};

/// Renderings of a map from one view, in linear light.
struct MapRendering {
  torch::Tensor color;  ///< [H,W,3] with the medium, if there is one
  /// [H,W,3] without the medium, lit as from this view, in the light that the colors are for.
  torch::Tensor restored;
  torch::Tensor depth;  ///< [H,W] along the optical axis [m], 0 where empty
  torch::Tensor alpha;  ///< [H,W] accumulated opacity
};

/// Renders the map without recording gradients, for a camera of gain one without vignetting.
MapRendering render_map(const Map& map, const gaussians::View& view);
/// The color of a rendering of this map with an amount of water: the attenuation and backscatter
/// coefficients of the medium times `amount`, at least 0; 1 gives `rendering.color`, 0
/// `rendering.restored`. Without a medium nothing changes.
torch::Tensor with_water(const Map& map, const gaussians::Intrinsics& camera,
                         const MapRendering& rendering, double amount);
/// Renders the medium without any surface [H,W,3]; undefined without a medium.
torch::Tensor render_open_water(const Map& map, const gaussians::Intrinsics& camera);

/// The gain of a keyframe [1]; for a held-out image, interpolated in time between the training
/// keyframes before and after it.
torch::Tensor camera_gain(const Map& map, const KeyframeStore& keyframes, std::size_t i);
/// Gain, illumination and vignetting at every pixel of a keyframe's camera reduced by `factor`,
/// multiplied: [H,W,3] with illumination, otherwise [H,W,1], or [1,1,1] where it is the same
/// everywhere.
torch::Tensor camera_response(const Map& map, const KeyframeStore& keyframes, std::size_t i,
                              int factor);

}  // namespace apvi::mapping
