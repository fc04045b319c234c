// SPDX-License-Identifier: BSD-3-Clause
#include "runs/view_run.hpp"

#include <chrono>
#include <thread>

#include "apvi/core/log.hpp"
#include "runs/stored_scene.hpp"

namespace apvi::runs {

namespace fs = std::filesystem;

void view_run(const fs::path& source, const viewer::ServerOptions& options,
              const std::function<bool()>& interrupted) {
  StoredScene scene(source);
  const viewer::Server server(scene, options);
  log::info("open {} in a browser; Ctrl-C ends", server.url());
  while (!interrupted()) std::this_thread::sleep_for(std::chrono::milliseconds(50));
}

}  // namespace apvi::runs
