// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <vector>

#include "apvi/medium/lamp.hpp"
#include "gaussians/render/view.hpp"

namespace apvi::medium {

/// Illumination of a scene by daylight and lamps that move with the camera. Without lamps, Eq. (8)
/// of the paper holds and its J is a property of the scene. The light of a lamp falls off with the
/// squared distance and is also attenuated on its way to the scene (near-field image formation of
/// Jaffe, "Computer modeling and the design of optimal underwater imaging systems", IEEE J. Oceanic
/// Eng. 15 (2), 1990), so J = C L with
///
///     E = sum over lamps of  share beam(angle) (d_1 / d)^2 exp(-beta_d (d - d_1)),
///     L = daylight + (1 - daylight) E,
///
/// where d is the distance from the lamp and C the color stored in the map: the appearance at L =
/// 1, on the axis of a single lamp at `unit_range_m`. The angle of incidence is part of C, which
/// may depend on the viewing direction. The water in front of the camera adds the backscatter
///
///     backscatter * integral over t from 0 to z of
///         sum over lamps of  share beam (d_1 / d)^2 exp(-beta_d (d - d_1 + t))
///
/// to the veiling light, with t and z along the ray.
struct LampLight {
  std::vector<Lamp> lamps;    ///< not empty, at most kMaxLamps
  double unit_range_m = 1.0;  ///< d_1
  torch::Tensor daylight;     ///< [3] RGB, in [0, 1)
  torch::Tensor backscatter;  ///< [3] RGB [1/m], not negative
};

inline constexpr double kLampMinDistance_m = 0.05;  ///< closer, the point-source model is invalid

/// Intensity of a beam relative to its axis: exp(-(linear x + square x^2)) with x = 1 - cos(angle),
/// 0 behind the lamp. Without `square` it is the bell of a von Mises-Fisher density; `square`
/// flattens the middle and makes the edge steeper, as reflectors and lenses do.
struct BeamProfile {
  double linear = 0.0;
  double square = 0.0;
};
BeamProfile beam_profile(const Lamp& lamp);

/// As a tensor [7 + 9 n] float64 on the CPU: unit range, daylight, backscatter; then of each of the
/// n lamps position, axis, half beam angle [rad], edge and share.
torch::Tensor lamp_to_tensor(const LampLight& light);
/// Whether `lamp_from_tensor` takes this many numbers.
bool is_lamp_tensor_size(std::int64_t count);
/// Inverse of `lamp_to_tensor`. Also takes the 7 + 8 n numbers of files from before there was an
/// edge, and the 14 of a single lamp from before there could be several: position, axis, half beam
/// angle, unit range, daylight, backscatter. Throws c10::Error for other shapes.
LampLight lamp_from_tensor(const torch::Tensor& numbers);

/// A quantity by channel [...,3], with its derivatives if they were asked for.
struct LampTerm {
  torch::Tensor value;
  torch::Tensor by_beta_d;     ///< of the same channel
  torch::Tensor by_half_beam;  ///< by the logarithm of all lamps' half beam angles
  torch::Tensor by_edge;       ///< by all lamps' edges
};

/// Light of lamps as a function of attenuation and of the shape of their beams; other geometry is
/// evaluated once.
class LampSum {
 public:
  /// E above at `points` [...,3] in the camera frame. With unit surface `normals` [...,3], of
  /// either sign, each lamp's part is times the cosine of its angle of incidence, at least 0.2.
  static LampSum irradiance(const std::vector<Lamp>& lamps, double unit_range_m,
                            const torch::Tensor& points, const torch::Tensor& normals = {});
  /// The backscatter integral above along unit vectors `rays` [...,3], up to the surfaces at
  /// `ranges` [...], which are limited to kLampMaxRange_m.
  static LampSum backscatter(const std::vector<Lamp>& lamps, double unit_range_m,
                             const torch::Tensor& rays, const torch::Tensor& ranges);

  /// With the beams of these lamps, which are otherwise those of the geometry.
  LampTerm at(const torch::Tensor& beta_d, const std::vector<Lamp>& lamps,
              bool with_derivatives = false) const;

 private:
  struct Part {
    std::size_t lamp;
    torch::Tensor weight;     ///< [...,1] everything but beam and attenuation
    torch::Tensor path;       ///< [...,1] length of the light's way, minus d_1 [m]
    torch::Tensor one_minus;  ///< [...,1] 1 - cos(angle from the axis)
  };
  std::vector<Part> parts_;
};

/// Mean distance of `points` [...,3] from the lamps, weighted by their shares: [...].
torch::Tensor distance_from_lamps(const std::vector<Lamp>& lamps, const torch::Tensor& points);

/// L at `points` [...,3] in the camera frame: [...,3].
torch::Tensor lamp_light(const LampLight& light, const torch::Tensor& beta_d,
                         const torch::Tensor& points);

inline constexpr double kLampMaxRange_m = 6.0;  ///< backscatter from beyond is negligible
/// backscatter * integral for the rays of a camera, as a volume [1,3,steps,nodes,nodes] for
/// interpolation (BackscatterTable).
torch::Tensor lamp_backscatter_table(const LampLight& light, const torch::Tensor& beta_d,
                                     const gaussians::Intrinsics& camera);

}  // namespace apvi::medium
