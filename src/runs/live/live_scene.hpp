// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"
#include "core/stopwatch.hpp"
#include "localization/fusion_stage.hpp"
#include "loop_closure/correction_log.hpp"
#include "runs/live/live_trace.hpp"
#include "runs/live/map_copier.hpp"
#include "runs/sensor_spans.hpp"
#include "runs/views/map_painter.hpp"
#include "slam/async_mapper.hpp"

namespace apvi::runs {

/// The map and the trajectory of a run while it is made. Views are drawn from copies of the map, so
/// that the mapper waits for the copy only.
class LiveScene : public viewer::Scene {
 public:
  explicit LiveScene(std::string name);

  void set_rig(const Rig& rig);
  /// Null: there is none any more. `save`: asks for the map to be saved.
  void set_mapper(slam::AsyncMapper* mapper, std::function<void()> save);
  void add(const SensorEvent& event);
  void set_loops(const std::vector<loop_closure::ClosedLoop>& loops);
  void add(const StampedPose& pose, const std::string& state);
  /// Adds the pose of a frame and what it changes about earlier ones.
  void add(const localization::FrameOutput& output);

  /// Poses since the last call; nothing when earlier ones have changed, too: then the whole scene
  /// is needed.
  std::optional<std::vector<viewer::TracePose>> take_new_poses();
  /// {"type": "map", ...} when the copy of the map is newer than at the last call, else empty.
  std::string take_map_message();
  /// Pings of the DVL since the last call.
  std::vector<viewer::BeamPing> take_new_pings();
  std::vector<viewer::SensorTrack> sensors() const;
  /// All loops when there are others than at the last call.
  std::optional<std::vector<viewer::LoopLine>> take_loops();
  /// Answers `save`: why the map is not saved, or an empty text.
  void set_saved(const std::string& error);
  /// The answer, once.
  std::optional<std::string> take_saved();
  /// Figures of the mapper for the page.
  std::int64_t keyframes() const;
  bool paused() const;

  std::optional<viewer::Rendering> render(const viewer::View& view) override;
  std::optional<double> depth(const viewer::Viewpoint& viewpoint, int column, int row) override;
  std::uint64_t version() const override;
  viewer::SceneDescription description() const override;
  void pause(bool paused) override;
  void save() override;

 private:
  void refresh();

  // Of `mapper_`. The other one is for moments only: the threads of the run wait for it.
  mutable std::mutex mapper_mutex_;
  slam::AsyncMapper* mapper_ = nullptr;
  std::function<void()> save_;  // while there is a mapper
  mutable std::mutex mutex_;
  viewer::SceneDescription description_;  // without trace and sensors
  std::optional<DvlCalibration> dvl_;
  SensorSpans spans_;
  std::size_t taken_pings_ = 0;
  bool loops_are_new_ = false;
  std::optional<std::string> saved_;
  LiveTrace trace_;
  std::size_t taken_ = 0;   // poses of the trace
  bool rewritten_ = false;  // earlier poses have changed
  bool map_is_new_ = false;
  Stopwatch since_start_;

  // Of the thread that draws.
  MapPainter painter_;

  MapCopier copier_;
};

}  // namespace apvi::runs
