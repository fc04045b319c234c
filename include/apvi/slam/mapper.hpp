// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>

#include "apvi/geometry/se3.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"
#include "apvi/slam/map_snapshot.hpp"
#include "apvi/slam/options.hpp"

namespace apvi::slam {

/// Mapping alone, as a library: images with known poses in; map snapshots and renders out. No
/// files, no command line.
///
/// `add`, `finish`, `refine` and `stop` are called from one thread; `map` and `render` from any
/// thread at any time. `Options::localization.run` decides on the threads, see `System`. A failure
/// of mapping is thrown by `add`, `finish` or `refine`. All errors derive from apvi::Error.
class Mapper {
 public:
  /// Of the rig, the first camera and the lamp are used. Throws InputError for contradictory
  /// options, and without a camera.
  Mapper(const Options& options, const Rig& rig);
  ~Mapper();
  Mapper(const Mapper&) = delete;
  Mapper& operator=(const Mapper&) = delete;

  /// Takes one image of the first camera with the pose of the body; in order of time. Surfaces are
  /// found by comparing it with the images around it.
  void add(const ImageFrame& image, const SE3& T_world_body);
  /// Completes everything taken in.
  void finish();
  /// Optimizes the finished map further: `mapping.final_iterations` steps.
  void refine();
  /// Abandons what the threads have not begun.
  void stop();

  /// nullopt before the first images are mapped.
  std::optional<MapSnapshot> map() const;
  /// nullopt before the first images are mapped. Throws InputError for a camera without pixels.
  std::optional<RenderedImages> render(const RenderView& view) const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace apvi::slam
