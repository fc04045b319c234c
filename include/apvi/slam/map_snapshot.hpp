// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "apvi/geometry/trajectory.hpp"
#include "apvi/medium/lamp.hpp"
#include "apvi/sensors/camera_model.hpp"

namespace apvi::slam {

/// The light of the rig's lamps on the scene and in the water, per color channel (RGB).
struct LampCoefficients {
  std::vector<medium::Lamp> lamps;      ///< in the frame of the first camera
  double unit_range_m = 1.0;            ///< range at which the map's colors are those of the lamps
  std::array<double, 3> daylight{};     ///< share of light that does not come from the lamps
  std::array<double, 3> backscatter{};  ///< [1/m]
};

/// The water: J exp(-beta_d z) + b_inf (1 - exp(-beta_b z)) per color channel (RGB), z the range.
struct MediumCoefficients {
  std::array<double, 3> beta_d{};  ///< attenuation [1/m]
  std::array<double, 3> beta_b{};  ///< backscatter [1/m]
  std::array<double, 3> b_inf{};   ///< veiling light, in linear light
  std::optional<LampCoefficients> lamp = std::nullopt;
};

/// How the camera turns light into image values: (1 + offset) light^(1/gamma) - offset.
struct ToneCoefficients {
  double gamma = 1.0;
  double offset = 0.0;
};

/// Vignetting of the lens: exp(-(square s + fourth s^2)) of the light arrives at a squared distance
/// s from the principal point, 1 in a corner of the image.
struct VignettingCoefficients {
  double square = 0.0;
  double fourth = 0.0;
};

/// A copy of the map, in the world frame of the trajectory; float arrays row by row. It has all
/// that `render` needs. Its colors are linear light; `tone_curve` turns them into image values.
struct MapSnapshot {
  std::int64_t iteration = 0;
  std::size_t count = 0;                   ///< number of Gaussians, n
  std::vector<float> means;                ///< [n,3] [m]
  std::vector<float> log_scales;           ///< [n,3] natural logarithm of the sigmas [m]
  std::vector<float> quaternions;          ///< [n,4] w x y z, not normalized
  std::vector<float> logit_opacities;      ///< [n]
  std::size_t sh_coefficients = 0;         ///< k: 1, 4, 9 or 16 a channel
  std::vector<float> spherical_harmonics;  ///< [n,k,3] RGB, degree 0 first
  std::optional<MediumCoefficients> medium;
  Trajectory keyframes;  ///< body poses, corrected by loop closures
  ToneCoefficients tone_curve = {};
  VignettingCoefficients vignetting = {};  ///< none in rendered images
  bool antialiased = false;                ///< renders lower the opacity of Gaussians below a pixel
  std::array<double, 3> origin{};  ///< to be added to `means` [m]; zero unless read from a file
};

/// A pinhole camera to render from; the center of the top-left pixel is (0, 0).
struct RenderView {
  CameraModel::Parameters camera;  ///< without distortion
  SE3 T_world_camera;              ///< looks along z, x right, y down
};

/// Rendered from one view, in image values; all arrays row by row.
struct RenderedImages {
  int width = 0;
  int height = 0;
  std::vector<float> color;     ///< [h,w,3] RGB with the medium
  std::vector<float> restored;  ///< [h,w,3] RGB without the medium
  std::vector<float> depth;     ///< [h,w] along the optical axis [m], 0 where empty
  std::vector<float> alpha;     ///< [h,w] accumulated opacity
};

/// Renders a copy of the map as System::render renders the map itself. Throws InputError for a
/// camera without pixels or arrays of contradictory sizes.
RenderedImages render(const MapSnapshot& map, const RenderView& view);

}  // namespace apvi::slam
