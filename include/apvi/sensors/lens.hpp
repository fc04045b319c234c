// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "apvi/sensors/camera_model.hpp"

/// Names and coefficient counts of the lens models, for files and messages.
namespace apvi {

/// The name in rig.yaml: none, radtan, equidistant, double_sphere or eucm.
std::string_view lens_name(Distortion distortion);
/// Numbers of coefficients that a lens takes in files: radtan 4, 5 or 8.
const std::vector<std::size_t>& coefficient_counts(Distortion distortion);
/// The shortest list of coefficients that says the same: radtan without trailing zeros has 4, 5 or
/// 8 of them.
std::vector<double> coefficients_of(const CameraModel::Parameters& camera);
/// Pixels per unit on the plane z = 1 near the optical axis, in x and y: fx and fy, but for
/// double_sphere fx / (1 + xi) and fy / (1 + xi).
Eigen::Vector2d focal_lengths(const CameraModel::Parameters& camera);
/// What is wrong with the coefficients: not finite, alpha outside [0, 1], xi outside (-1, 1), beta
/// not positive. nullopt if nothing is.
std::optional<std::string> lens_problem(const CameraModel::Parameters& camera);

/// The distortion and coefficients of a list. Without `distortion`, an empty list is `none` and
/// five or eight numbers are radtan; `none` takes zeros. Throws std::invalid_argument that says
/// which models or counts fit.
void set_lens(std::optional<Distortion> distortion, const std::vector<double>& coefficients,
              CameraModel::Parameters& camera);

}  // namespace apvi
