// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <Eigen/Core>
#include <array>
#include <optional>
#include <vector>

#include "change/registration.hpp"
#include "change/session.hpp"

namespace apvi::change {

struct Options {
  double min_size_m = 0.1;  ///< shorter changes are left out
  double cell_m = 0.0;      ///< edge of the cells; 0: a quarter of `min_size_m`
};

enum class Kind { appeared, vanished, color };
const char* to_string(Kind kind);

/// A place that has changed; coordinates in the frame of the earlier session [m].
struct Change {
  Kind kind = Kind::appeared;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();  ///< mean of its cells
  Eigen::Vector3d low = Eigen::Vector3d::Zero();     ///< corner of the box around them
  Eigen::Vector3d high = Eigen::Vector3d::Zero();
  double length_m = 0.0;  ///< see Extent
  double width_m = 0.0;
  double area_m2 = 0.0;
  /// Mean distance between the surfaces of the two sessions; zero for a color [m].
  double relief_m = 0.0;
  double views = 0.0;       ///< median number of views of the other session that decided
  double confidence = 0.0;  ///< share of these in favor; of colors 1 - 4 / distance^2
  /// Mean light without water, RGB, each in the units of its session.
  std::optional<std::array<double, 3>> before{}, after{};
  /// Of colors: median factors by which the light is off what the other surfaces have.
  std::optional<std::array<double, 3>> factors{};
  /// Of something that appeared: which change vanished elsewhere with its size and color.
  std::optional<std::size_t> moved_from{};
  gaussians::View view;  ///< of the earlier session where it vanished, otherwise of the later one
  torch::Tensor points;  ///< [n,3] its cells
};

/// What was seen of a place.
enum class Seen : unsigned char { both, only_before, only_after };

/// Everything that two sessions say about a place.
struct ChangeMap {
  std::vector<Change> changes;  ///< by kind, the larger ones first
  Registration registration;
  std::array<double, 3> color_slope{}, color_offset{};  ///< see ColorResiduals; zero: unknown
  std::array<double, 2> black{};         ///< light added before logarithms, earlier and later
  std::array<double, 2> enough_views{};  ///< that decide about a cell, earlier and later
  double cell_m = 0.0;
  torch::Tensor points;  ///< [n,3] cells of both surfaces in the frame of the earlier session [m]
  torch::Tensor seen;    ///< [n] uint8: Seen
  /// Areas as seen along z [m^2].
  double compared_m2 = 0.0, only_before_m2 = 0.0, only_after_m2 = 0.0;

  /// Light [...,3] of the later session as the earlier one would have it.
  torch::Tensor as_before(const torch::Tensor& light) const;
};

/// Compares the maps of two sessions.
///
/// Each map is drawn in its own views, where the images constrain it. Its surface is gathered in
/// cells of a sparse grid, and the residual motion between the sessions is taken out. The views of
/// the other session then vote on each cell: those that see through it to a surface behind, and
/// those that show the same surface. A cell of the later surface that the earlier views have seen
/// through has appeared, the mirror image has vanished. Both maps are then drawn in the same views,
/// and how the cells look is compared after a robust transfer of colors; that also tells surfaces
/// that are wrong from those that have changed. Cells that too few views decide about are not known
/// in both sessions. Neighboring cells form a change. Throws InputError when a session shows no
/// surface, or the two have none in common.
ChangeMap find_changes(const Session& before, const Session& after, const Options& options,
                       const Progress& progress);

}  // namespace apvi::change
