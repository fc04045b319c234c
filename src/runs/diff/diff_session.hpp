// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "change/change_map.hpp"
#include "map_io/origin.hpp"
#include "mapping/appearance/display_exposure.hpp"

namespace apvi::runs {

/// Two runs in one frame, whose origin is that of the earlier map.
struct DiffSessions {
  change::Session before, after;
  map_io::Origin origin{};
  bool z_down = false;  ///< of the recording's world
};
/// Throws InputError when a folder has no map, keyframes or configuration.
void check_mapping_run(const std::filesystem::path& run);
/// Of two such folders. Throws InputError when their content is invalid.
DiffSessions load_sessions(const std::filesystem::path& before, const std::filesystem::path& after);

/// Colors of both sessions in the light of the earlier one, for viewing.
class DiffColors {
 public:
  DiffColors(const DiffSessions& sessions, const change::ChangeMap& changes);

  /// Image values in [0, 1] of light [...,3] of the earlier and of the later map, without water.
  torch::Tensor before(const torch::Tensor& light) const;
  torch::Tensor after(const torch::Tensor& light) const;

 private:
  const change::ChangeMap& changes_;
  mapping::DisplayExposure exposure_;
  gaussians::ToneCurve curve_;
};

}  // namespace apvi::runs
