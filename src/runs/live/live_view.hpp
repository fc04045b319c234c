// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "runs/run_observer.hpp"
#include "viewer/server.hpp"

namespace apvi::runs {

/// The viewer's page of a run while it is made.
class LiveView : public RunObserver {
 public:
  /// Serves the page from now on. `name`: of the run. Throws as viewer::Server.
  LiveView(const std::string& name, const viewer::ServerOptions& options);
  ~LiveView() override;

  void begin(const Rig& rig) override;
  void sample(const SensorEvent& event) override;
  void ping(const localization::PingOutput& output) override;
  void frame(const localization::FrameOutput& output) override;
  void image(const localization::MapFrame& frame) override;
  void map_begins(slam::AsyncMapper& mapper, std::function<void()> save) override;
  void map_ends() override;
  void map_saved(const std::string& error) override;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace apvi::runs
