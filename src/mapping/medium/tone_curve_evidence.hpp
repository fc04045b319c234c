// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "apvi/mapping/options.hpp"
#include "gaussians/render/tone_curve.hpp"

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// What the images tell about the camera's tone curve: linear, or the power 1/2.2 of cameras whose
/// images are for viewing.
///
/// Backscatter adds to the light of a surface. So at one range, images of bright and dark surfaces
/// follow the medium only in linear light; the right curve leaves smaller residuals in the fit of
/// the medium. Images of a nonlinear camera can often be explained by a linear one in other water,
/// but hardly the reverse. So the power is assumed unless the linear fit is clearly better.
class ToneCurveEvidence {
 public:
  explicit ToneCurveEvidence(ToneCurveOptions options);

  /// Adds an estimation: deviances (medium::MediumFit::deviance) of the same image values with both
  /// curves. Earlier estimations decay, because the map improves.
  void add(double linear_deviance, double power_deviance);
  /// Whether the curve is given or beyond doubt, so that there is no need for more.
  bool is_decided() const;
  /// The curve before the first estimation.
  gaussians::ToneCurve initial() const;
  /// The more probable curve.
  gaussians::ToneCurve choice() const;

  void save(torch::serialize::OutputArchive& archive) const;
  void load(torch::serialize::InputArchive& archive);

 private:
  std::optional<gaussians::ToneCurve> given_;
  double for_linear_ = 0.0;  ///< deviance that the linear curve saves
};

inline constexpr gaussians::ToneCurve kViewingCurve{.gamma = 2.2};

}  // namespace apvi::mapping
