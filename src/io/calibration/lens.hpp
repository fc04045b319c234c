// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string_view>
#include <vector>

#include "io/calibration/entry.hpp"

namespace apvi::io {

/// Throws InputError when the camera model is not a pinhole.
void check_pinhole(const Entry& model);

/// Sets `distortion` and `coefficients` of a camera section. Names of the models are those of
/// Kalibr, EuRoC, OpenVINS, ROS and OpenCV. Coefficients of a radial-tangential or rational lens
/// after the eighth (thin prism, tilt) must be zero. Throws InputError for any other lens, and for
/// a wrong number of coefficients.
void set_lens(const Entry& model, const Entry& coefficients, config::Node& camera);
/// As above, with coefficients that the file has as single keys.
void set_lens(const Entry& model, const Entry& place, const std::vector<double>& coefficients,
              config::Node& camera);
/// As above, of `distortion_model` and the list `coefficients` of a camera, as Kalibr and EuRoC
/// have them. Nothing is set without both; one alone is an InputError, unless the model is "none".
void set_lens_of(const config::Node& from, std::string_view path, std::string_view coefficients,
                 config::Node& camera);

}  // namespace apvi::io
