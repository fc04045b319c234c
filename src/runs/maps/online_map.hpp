// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <map>
#include <optional>
#include <string>

#include "core/status_line.hpp"
#include "core/stopwatch.hpp"
#include "runs/maps/map_files.hpp"
#include "runs/maps/mapping_run.hpp"
#include "runs/run_config.hpp"
#include "slam/async_mapper.hpp"

namespace apvi::runs {

/// The map of a run with localization, and its files in the run folder.
class OnlineMap {
 public:
  /// Both must outlive this.
  OnlineMap(const RunConfig& config, const MappingRunOptions& options, const Rig& rig);

  /// Opens mapping.csv. Once the run folder exists, before the first frame.
  void open_files();
  /// Writes map.ply, medium.json, keyframes.tum, loops.csv and checkpoint.pt.
  void save();
  /// Has the map saved as soon as no frame or step is processed; any thread. The observer is told.
  void request_save() { save_asked_ = true; }
  /// Throws what has disabled mapping while localization continued, if anything has. The map so far
  /// has been saved then. After `mapper().finish()`.
  void rethrow_failure() const;
  /// Time spent by activity [s]: of the mapper's thread, and for saving.
  std::map<std::string, double> times() const;

  slam::AsyncMapper& mapper() { return mapper_; }

 private:
  void write_periodic_output();
  void show(const slam::FinalProgress& progress);
  void save_map();  ///< all but keyframes.tum and loops.csv
  void save_if_asked();
  void answer_save(const std::string& error);
  void report_failure();

  const RunConfig& config_;
  const MappingRunOptions& options_;
  Stopwatch watch_;
  Stopwatch since_save_;
  double saving_s_ = 0.0;
  double last_save_s_ = 0.0;
  std::atomic<bool> save_asked_ = false;
  std::optional<MappingLog> log_;     // once there is a folder
  std::optional<StatusLine> status_;  // during the work after the last frame
  slam::AsyncMapper mapper_;          // last: its thread ends before what it uses
};

}  // namespace apvi::runs
