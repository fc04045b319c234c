// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <array>
#include <vector>

#include "apvi/splat/view.hpp"

namespace apvi::splat {

/// A lamp on the vehicle, in the camera's frame (right, down, forward).
struct Lamp {
  std::array<double, 3> position_m{};
  std::array<double, 3> axis{0.0, 0.0, 1.0};  ///< unit vector of its beam
  double half_beam_rad = 1.0;  ///< angle at which it is half as bright as on its axis
};

/// The light that a scene is seen in when a lamp moves with the camera. Daylight is all there is
/// without: Eq. (8) of the paper, whose J is then a property of the scene. A lamp's light falls
/// with the square of the distance and is absorbed on its way out, too (the near-field image
/// formation of Jaffe, "Computer modeling and the design of optimal underwater imaging systems",
/// IEEE J. Oceanic Eng. 15 (2), 1990), so J = C L with
///
///     E = beam(angle) (d_1 / d)^2 exp(-beta_d (d - d_1)),  L = daylight + (1 - daylight) E,
///
/// where d is the distance from the lamp, and C what the map holds: how the scene looks where L is
/// one, on the lamp's axis at `unit_range_m`. Which way a surface faces is left to C, which may
/// change with direction. To the veil comes what the water before the camera sends back,
///
///     glow * integral over t from 0 to z of  beam (d_1 / d)^2 exp(-beta_d (d - d_1 + t)),
///
/// t and z along the ray.
struct LampLight {
  Lamp lamp;
  double unit_range_m = 1.0;  ///< d_1
  torch::Tensor daylight;     ///< [3] RGB, in [0, 1)
  torch::Tensor glow;         ///< [3] RGB [1/m], not negative
};

inline constexpr double kLampNearest_m = 0.05;  ///< nearer, a lamp is no point
/// Of a beam exp(sharpness (cos - 1)).
double lamp_sharpness(const Lamp& lamp);

inline constexpr int kLampNumbers = 14;
/// As so many numbers, float64 on the CPU: position, axis, half beam [rad], unit range, daylight,
/// glow.
torch::Tensor to_numbers(const LampLight& light);
/// Inverse of `to_numbers`. Throws c10::Error for other shapes.
LampLight lamp_from_numbers(const torch::Tensor& numbers);

/// A quantity by colour, with its derivative by beta_d of that colour.
struct LampTerm {
  torch::Tensor value;      ///< [...,3]
  torch::Tensor by_beta_d;  ///< [...,3]
};
/// E above at `points` [...,3] in the camera's frame.
LampTerm lamp_shine(const Lamp& lamp, double unit_range_m, const torch::Tensor& beta_d,
                    const torch::Tensor& points);

/// The integral above for any attenuation: what geometry says of it is worked out once.
class LampHaze {
 public:
  /// `rays` [...,3] unit vectors, up to `ranges` [...] of the surfaces; kLampReach_m stands for all
  /// that are farther.
  LampHaze(const Lamp& lamp, double unit_range_m, const torch::Tensor& rays,
           const torch::Tensor& ranges);
  LampTerm at(const torch::Tensor& beta_d) const;

 private:
  std::vector<torch::Tensor> ways_;     ///< [...,1] by step: of the light, less d_1 [m]
  std::vector<torch::Tensor> weights_;  ///< [...,1]: brightness there times the step
};

/// The integral above along unit vectors `rays` [...,3], up to `ranges` [...] of the surfaces;
/// kLampReach_m stands for all that are farther.
LampTerm lamp_haze(const Lamp& lamp, double unit_range_m, const torch::Tensor& beta_d,
                   const torch::Tensor& rays, const torch::Tensor& ranges);

/// L at `points` [...,3] in the camera's frame: [...,3].
torch::Tensor lamp_light(const LampLight& light, const torch::Tensor& beta_d,
                         const torch::Tensor& points);

inline constexpr double kLampReach_m = 6.0;  ///< what water farther off sends back does not count
/// glow * integral for the pictures of a camera, as a volume [1,3,steps,nodes,nodes] to interpolate
/// in (HazeTable).
torch::Tensor lamp_haze_table(const LampLight& light, const torch::Tensor& beta_d,
                              const Intrinsics& camera);

}  // namespace apvi::splat
