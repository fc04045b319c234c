// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>

#include "runs/maps/stored_map.hpp"
#include "runs/views/map_painter.hpp"

namespace apvi::runs {

/// The map of a run folder with its trajectory, or a map file alone.
class StoredScene : public viewer::Scene {
 public:
  /// `with_levels`: see MapPainter::set_map. Throws InputError for a folder without a map or a
  /// damaged file.
  StoredScene(const std::filesystem::path& source, bool with_levels);

  std::optional<viewer::Rendering> render(const viewer::View& view) override {
    return painter_.render(view);
  }
  std::optional<double> depth(const viewer::Viewpoint& viewpoint, int column, int row) override {
    return painter_.depth(viewpoint, column, row);
  }
  std::uint64_t version() const override { return 1; }
  viewer::SceneDescription description() const override;
  void pause(bool) override {}
  void save() override {}

  /// Reads the beams of the DVL from the recording, which may take a while; any thread. False if
  /// there are none, or `interrupted`.
  bool load_beams(const std::function<bool()>& interrupted);

  MapPainter& painter() { return painter_; }

 private:
  std::vector<gaussians::View> describe_run(const std::filesystem::path& run,
                                            const map_io::Origin& origin);

  std::optional<RunConfig> config_;  // of a run
  mutable std::mutex mutex_;         // of the beams in `description_`
  viewer::SceneDescription description_;
  MapPainter painter_;
};

/// What the viewer says of a run's camera: focal length, aspect, mounting.
void describe_camera(const CameraMount& mount, viewer::SceneDescription& description);

}  // namespace apvi::runs
