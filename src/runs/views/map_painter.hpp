// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <future>
#include <optional>
#include <vector>

#include "gaussians/detail/detail_levels.hpp"
#include "mapping/appearance/display_exposure.hpp"
#include "mapping/rendering.hpp"
#include "runs/views/map_section.hpp"
#include "viewer/scene.hpp"

namespace apvi::runs {

/// Draws a map for the viewer, with the pixels of `apvi render`. One thread at a time.
class MapPainter {
 public:
  /// `views`: those whose restored renders decide on the exposure, see mapping::display_exposure;
  /// empty: the first view that is drawn without the medium. `with_levels`: draw what is far away
  /// in less detail (gaussians::DetailLevels), as soon as that is prepared; for maps that stay.
  void set_map(mapping::Map map, std::vector<gaussians::View> views, bool with_levels);
  bool empty() const { return map_.gaussians.size() == 0; }
  const mapping::Map& map() const { return map_; }
  /// Brightness and white balance of restored images. `camera`: the view to choose it by when
  /// `set_map` got none.
  mapping::DisplayExposure exposure(const gaussians::View& camera);

  /// Nothing without a map.
  std::optional<viewer::Rendering> render(const viewer::View& view);
  /// See viewer::Scene::depth.
  std::optional<double> depth(const viewer::Viewpoint& viewpoint, int column, int row) const;

 private:
  mapping::MapRendering rendering(const gaussians::View& camera, const viewer::View& view);
  torch::Tensor color(const viewer::View& view, const gaussians::View& camera,
                      const mapping::MapRendering& rendering);

  mapping::Map map_;
  std::future<gaussians::DetailLevels> coming_levels_;
  std::optional<gaussians::DetailLevels> levels_;
  mutable MapSection section_;  // of `map_`
  std::vector<gaussians::View> views_;
  std::optional<mapping::DisplayExposure> exposure_;  // once it is needed: it takes a second
};

/// What of a map the page needs to know: extent and medium. `up` is not set.
struct MapExtent {
  std::int64_t gaussians = 0;
  bool medium = false;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();  ///< medians of the coordinates [m]
  double radius_m = 1.0;                             ///< of the ball that holds 80 % of the map
};
MapExtent extent_of(const mapping::Map& map);

}  // namespace apvi::runs
