// SPDX-License-Identifier: BSD-3-Clause
#include "sim/simulate.hpp"

#include <system_error>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/interrupt.hpp"
#include "core/stopwatch.hpp"
#include "core/text_file.hpp"
#include "sim/sensors/frames.hpp"
#include "sim/writers/formats.hpp"

namespace apvi::sim {
namespace {

namespace fs = std::filesystem;

constexpr const char* kFingerprintFile = "truth/scene.yaml";

std::string_view format_name(OutputFormat format) {
  switch (format) {
    case OutputFormat::folder:
      return "folder";
    case OutputFormat::euroc:
      return "euroc";
    case OutputFormat::rosbag:
      return "rosbag";
    case OutputFormat::tank:
      return "tank";
    case OutputFormat::colmap:
      return "colmap";
  }
  return "";
}

// Everything that determines the content of the dataset. Stored in it, to decide whether a
// simulation can be resumed.
std::string scene_fingerprint(const Scene& scene, OutputFormat format) {
  std::string rig = config::to_yaml(scene.rig_node);
  for (std::size_t at = 0; (at = rig.find('\n', at)) != std::string::npos; at += 3) {
    rig.replace(at, 1, "\n# ");
  }
  return fmt::format("# simulated as {}\n{}\n# with the rig\n# {}\n", format_name(format),
                     config::to_yaml(config::to_node(scene.config)), rig);
}

bool is_complete(const fs::path& out, const std::string& fingerprint) {
  if (!fs::exists(out)) return false;
  if (fs::is_directory(out) && fs::is_empty(out)) return false;
  if (fs::exists(out / kFingerprintFile) && read_text(out / kFingerprintFile) == fingerprint)
    return true;
  fail_input("{}: exists and is not the dataset of this scene; delete it or choose another -o",
             out.string());
}

void open_partial(const fs::path& partial, const std::string& fingerprint) {
  const fs::path marker = partial / kFingerprintFile;
  if (fs::exists(marker)) {
    if (read_text(marker) == fingerprint) {
      log::info("{}: resuming the interrupted simulation", partial.string());
      return;
    }
    fail_input("{}: belongs to another scene, format or version; delete it to start over",
               partial.string());
  }
  if (fs::exists(partial) && !fs::is_empty(partial)) {
    fail_input("{}: exists already; delete it or choose another -o", partial.string());
  }
  std::error_code error;
  fs::create_directories(marker.parent_path(), error);
  if (error) {
    fail_input("{}: cannot create this folder: {}; choose another -o", partial.string(),
               error.message());
  }
  write_file(marker, fingerprint);
}

void move_into_place(const fs::path& partial, const fs::path& out) {
  std::error_code error;
  if (fs::exists(out)) fs::remove(out, error);  // an empty folder, see is_complete
  fs::rename(partial, out, error);
  if (error) {
    fail_run("{}: complete, but cannot rename it to {}: {}", partial.string(), out.string(),
             error.message());
  }
}

}  // namespace

SimulateResult simulate(const Scene& scene, const fs::path& out, const SimulateOptions& options) {
  const std::string fingerprint = scene_fingerprint(scene, options.format);
  if (is_complete(out, fingerprint)) return SimulateResult::already_complete;
  fs::path partial = out;
  partial += ".partial";
  const InterruptGuard interrupt;
  const Stopwatch watch;
  const EventSchedule events = make_schedule(scene.config);
  const TriangleMesh mesh = make_world(scene.config.world, scene.seed());
  const RayCaster world(mesh);
  const Recording recording = simulate_sensors(scene, events, world);
  log::debug("world of {} triangles and sensors after {:.1f} s", mesh.triangles.size(),
             watch.seconds());
  open_partial(partial, fingerprint);
  const Exposures exposures = render_frames(partial, options.format, scene, events, recording, mesh,
                                            world, options.threads, interrupt);
  if (interrupt.interrupted()) {
    fail_run("interrupted; partial results are in {}; run the same command again to resume",
             partial.string());
  }
  write_recording(partial, options.format, scene, recording);
  write_exposures(partial, scene, recording, exposures);
  write_truth(partial, scene, events, recording, mesh);
  move_into_place(partial, out);
  return SimulateResult::written;
}

}  // namespace apvi::sim
