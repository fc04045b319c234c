// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "mapping/appearance/display_exposure.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/rendering.hpp"
#include "medium/medium.hpp"
#include "runs/quality/simulated_truth.hpp"

namespace apvi::runs {

/// Errors against simulated ground truth, of one view or all; unknown ones are absent.
struct TruthErrors {
  std::optional<double> depth_mean_m;  ///< of the ground truth
  std::optional<double> depth_rmse_m;
  std::optional<double> depth_abs_rel;
  std::optional<double> depth_seen_rmse_m;        ///< over visible surfaces
  std::optional<double> depth_half_pixel_rmse_m;  ///< of the ground truth shifted by half a pixel
  std::optional<double> restored_psnr_db;
  std::optional<double> restored_seen_psnr_db;
  std::optional<double> static_psnr_db;  ///< of the image where nothing moves
};

using ErrorMember = std::optional<double> TruthErrors::*;
struct NamedError {
  const char* name = nullptr;
  ErrorMember value = nullptr;
  bool is_rmse = false;
};
inline constexpr std::array<NamedError, 8> kErrorColumns = {
    {{"depth_mean_m", &TruthErrors::depth_mean_m},
     {"depth_rmse_m", &TruthErrors::depth_rmse_m, true},
     {"depth_abs_rel", &TruthErrors::depth_abs_rel},
     {"depth_seen_rmse_m", &TruthErrors::depth_seen_rmse_m, true},
     {"depth_half_pixel_rmse_m", &TruthErrors::depth_half_pixel_rmse_m, true},
     {"restored_psnr_db", &TruthErrors::restored_psnr_db},
     {"restored_seen_psnr_db", &TruthErrors::restored_seen_psnr_db},
     {"static_psnr_db", &TruthErrors::static_psnr_db}}};

/// Errors of a rendering, in image values, of a keyframe. `water`: the true medium, which decides
/// what is visible.
TruthErrors compare(const mapping::MapRendering& rendering, const mapping::Keyframe& keyframe,
                    const SimulatedTruth& truth, const std::optional<medium::Medium>& water);

/// Mean, or root mean square for RMSE columns, over the views that have a value.
std::optional<double> mean_of(const std::vector<TruthErrors>& views, const NamedError& column);

/// One factor per channel for the whole map between its restored light and the true images without
/// water, by least squares over visible and unsaturated pixels of all held-out views. Images do not
/// tell exposure and white balance, so a truth of its own exposure is compared after these factors.
/// Nothing for a truth in the exposure of the camera.
std::optional<mapping::DisplayExposure> exposure_of_truth(const mapping::Map& map,
                                                          const mapping::KeyframeStore& keyframes,
                                                          const SimulatedTruth& truth);

}  // namespace apvi::runs
