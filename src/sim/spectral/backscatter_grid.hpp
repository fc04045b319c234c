// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <opencv2/core/types.hpp>
#include <vector>

#include "sim/render/lens_rays.hpp"
#include "sim/render/ray_caster.hpp"
#include "sim/render/shading.hpp"
#include "sim/spectral/sea_state.hpp"

namespace apvi::sim {

/// The light that the water scatters into the camera, by direction and range: the integral of
/// single scattering along rays on a coarse grid of the image,
///     V(r) = int_0^r pi b S(t) exp(-smooth t) dt,
/// where the source S is daylight (its direct part where the sun is not hidden by the scene, and
/// its diffuse part) and the lamps, times the phase function. In raw values of the sensor, where a
/// white surface in unit irradiance has 1. Ends at the surface of the water.
class BackscatterGrid {
 public:
  /// Pixels between the rays of the grid: `step` px.
  BackscatterGrid(const Lens& lens, int step, const SE3& T_world_camera, const Sea& sea,
                  const SeaState& state, const std::vector<LampPose>& lamps,
                  const RayCaster& world);

  /// Adds the backscatter to `observed`. The pixels of the tile are `area`; the rays without a
  /// surface end at the surface of the water or at the visible range.
  void add_to(const cv::Rect& area, TileRays& tile) const;
  /// Backscatter of the ray nearest a pixel up to `range` [m].
  Eigen::Vector3f at(int x, int y, float range) const;

  /// Range up to which the integral reaches [m].
  static float max_range();

 private:
  using Profile = std::array<float, std::size_t{3} * 37>;  ///< accumulated raw values at the nodes

  std::size_t vertex(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(column);
  }

  int step_;
  int columns_;
  int rows_;
  cv::Size image_;
  std::vector<Profile> profiles_;
};

}  // namespace apvi::sim
