// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "apvi/config/fields.hpp"
#include "sim/spectral/lamp_light.hpp"
#include "sim/spectral/sensor.hpp"
#include "sim/spectral/tone_curve.hpp"

namespace apvi::sim {

/// How light and water are simulated.
enum class Physics {
  paper,    ///< the image formation model of the estimator, in three channels
  spectral  ///< radiative transfer with single scattering in kBands bands, and a camera's pipeline
};

enum class WhiteBalance {
  daylight,  ///< white in daylight at the surface is white
  preset,    ///< set once by a gray card in the scene's light
  automatic  ///< follows the mean color of the image
};

/// The `spectral` section: what only spectral physics has.
struct SpectralConfig {
  SensorType sensor = SensorType::nikon_d5100;
  WhiteBalance white_balance = WhiteBalance::automatic;
  ToneCurve tone = ToneCurve::srgb;
  double color_correction = 0.5;
  double exposure_lag_s = 0.5;
  double white_balance_lag_s = 2.0;
  double lens_shading = 0.2;
  int jpeg_quality = 92;
  std::vector<SpectralLampConfig> lamps{};

  template <typename V>
  void visit(V& v) {
    using config::Choices;
    using config::Range;
    v("sensor", sensor,
      Choices<SensorType>{{"nikon_d5100", SensorType::nikon_d5100},
                          {"galaxy_s20", SensorType::galaxy_s20}},
      "camera whose measured spectral sensitivities are used");
    v("white_balance", white_balance,
      Choices<WhiteBalance>{{"daylight", WhiteBalance::daylight},
                            {"preset", WhiteBalance::preset},
                            {"auto", WhiteBalance::automatic}},
      "daylight: fixed for daylight in air; preset: fixed by a gray card 1.5 m away at "
      "water.reference_depth_m; auto: toward gray, with a lag; camera.white_balance replaces it");
    v("tone", tone,
      Choices<ToneCurve>{{"linear", ToneCurve::linear},
                         {"srgb", ToneCurve::srgb},
                         {"gamma", ToneCurve::gamma},
                         {"film", ToneCurve::film}},
      "curve from light to pixel: linear, sRGB, camera.gamma, or sRGB with the S-shaped contrast "
      "of consumer cameras");
    v("color_correction", color_correction, Range{0.0, 1.0},
      "how far the camera's color matrix undoes the overlap of its channels");
    v("exposure_lag_s", exposure_lag_s, Range{0.0, 10.0},
      "time constant of the automatic exposure [s]");
    v("white_balance_lag_s", white_balance_lag_s, Range{0.0, 60.0},
      "time constant of the automatic white balance [s]");
    v("lens_shading", lens_shading, Range{0.0, 1.0},
      "loss in the corners by the lens barrel, on top of cos^4 of the angle from the axis");
    v("jpeg_quality", jpeg_quality, Range{0, 100},
      "quality of the JPEG (4:2:0) that images pass through; 0: none");
    v("lamps", lamps, "lamps on the vehicle, at most two; lamp0 and lamp1 in rig.yaml");
  }
};

}  // namespace apvi::sim
