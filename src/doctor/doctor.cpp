// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/doctor.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <filesystem>
#include <memory>

#include "apvi/core/error.hpp"
#include "doctor/checks.hpp"
#include "doctor/static_parts.hpp"

namespace apvi::doctor {
namespace {

namespace fs = std::filesystem;
using Reader = std::unique_ptr<io::SequenceReader>;

constexpr std::size_t kProgressEvery = 4096;

void add_problem(Report& report, const std::string& sensor, const std::string& check,
                 const std::string& what) {
  report.add({Severity::error, sensor, check, what, "", {}});
}

// Opens the sensors that can be opened, when not all of the recording can.
Reader open_part(const io::DatasetConfig& config, const InputError& why, Report& report) {
  const std::vector<std::pair<std::string, std::vector<std::string>>> kinds = {
      {"imu", {"imu0"}},
      {"dvl", {"dvl0"}},
      {"pressure", {"pressure0", "depth0"}},
      {"camera", {"cam0", "cam1"}}};
  std::vector<std::string> usable;
  std::vector<std::pair<std::vector<std::string>, std::string>> failed;
  Reader any;
  for (const auto& [kind, names] : kinds) {
    try {
      any = io::open_sequence(config, {kind});
      usable.push_back(kind);
    } catch (const InputError& e) {
      failed.emplace_back(names, e.what());
    }
  }
  if (usable.empty()) throw why;
  for (const auto& [names, message] : failed) {
    const bool claimed = std::any_of(names.begin(), names.end(), [&](const std::string& name) {
      return any->rig().find(name) != nullptr;
    });
    if (claimed || message == why.what()) add_problem(report, names.front(), "files", message);
  }
  return io::open_sequence(config, usable);
}

Reader open(const io::DatasetConfig& config, Report& report) {
  try {
    return io::open_sequence(config, {});
  } catch (const InputError& e) {
    return open_part(config, e, report);
  }
}

void check_rig(const config::Node& node, CheckInput& c, Report& report) {
  if (node.is_null()) {
    report.add({Severity::warning,
                "rig",
                "file",
                "the recording has no calibration",
                "write a rig.yaml next to mav0, or use --rig; docs/formats.md has an example",
                {}});
    return;
  }
  try {
    c.rig = make_rig(node);
    c.has_rig = true;
    report.add({Severity::ok, "rig", "file", "valid", "", {}});
  } catch (const InputError& e) {
    add_problem(report, "rig", "file", e.what());
  }
}

// The reader skips cameras that the rig does not describe.
void check_left_out_cameras(const io::DatasetConfig& config, const config::Node& rig,
                            Report& report) {
  for (const char* name : {"cam0", "cam1"}) {
    std::error_code unreadable;
    const fs::path file = fs::path(config.path) / "mav0" / name / "data.csv";
    if (rig.is_null() || rig.find(name) != nullptr || !fs::exists(file, unreadable)) continue;
    report.add(
        {Severity::warning,
         name,
         "rig",
         "recorded, but the rig does not describe it",
         fmt::format("calibrate it and add a {} section to rig.yaml; otherwise it is not used",
                     name),
         {}});
  }
}

void read_all(io::SequenceReader& reader, const Options& options, Collector& collector,
              Report& report) {
  try {
    std::size_t count = 0;
    while (const auto event = reader.next()) {
      collector.add(*event);
      if (++count % kProgressEvery != 0) continue;
      if (options.progress) options.progress(reader.fraction());
      if (options.interrupted && options.interrupted()) {
        report.add({Severity::note,
                    "recording",
                    "interrupted",
                    fmt::format("only the first {:.0f} % of the recording was read",
                                100.0 * reader.fraction()),
                    "",
                    {}});
        return;
      }
    }
  } catch (const std::exception& e) {
    add_problem(report, "recording", "reading", fmt::format("stopped early: {}", e.what()));
  }
}

std::optional<Trajectory> reference_of(const io::SequenceReader& reader, Report& report) {
  try {
    return reader.reference();
  } catch (const std::exception& e) {
    add_problem(report, "reference", "file", e.what());
    return std::nullopt;
  }
}

// Reads images a second time, as only now it is known where the vehicle turned.
void match_images_of(const io::DatasetConfig& config, const Options& options, CheckInput& c,
                     Report& report) {
  constexpr std::size_t kSpans = 13;
  const CameraObservations& camera = c.observed.cameras[0];
  if (!c.has_rig || c.rig.cameras.empty() || camera.timing.count < 2) return;
  const InertialPath path(c.observed.imu.buffer);
  const auto spans = turning_spans(path, {camera.timing.first, camera.timing.last}, kSpans);
  if (spans.empty()) return;
  try {
    c.image_pairs = match_images(config, spans, options.interrupted);
  } catch (const std::exception& e) {
    add_problem(report, "cam0", "images", fmt::format("cannot be read again: {}", e.what()));
  }
}

// Only of cameras without a mask.
void find_static_parts_of(const io::DatasetConfig& config, const Options& options, CheckInput& c,
                          Report& report) {
  for (std::size_t i = 0; i < c.rig.cameras.size(); ++i) {
    c.static_shares.push_back(0.0);
    if (!c.rig.cameras[i].mask.empty() || c.observed.cameras.at(i).timing.count == 0) continue;
    try {
      const auto parts = find_static_parts(
          config, {.camera = static_cast<int>(i), .interrupted = options.interrupted});
      if (parts) c.static_shares.back() = parts->share();
    } catch (const std::exception& e) {
      add_problem(report, fmt::format("cam{}", i), "images",
                  fmt::format("cannot be read again: {}", e.what()));
    }
  }
}

// Groups findings by sensor, in a fixed order.
void sort_by_sensor(Report& report) {
  const std::vector<std::string> order = {"rig",    "recording", "imu0", "dvl0",  "pressure0",
                                          "depth0", "cam0",      "cam1", "gnss0", "reference"};
  const auto rank = [&order](const Finding& f) {
    return std::find(order.begin(), order.end(), f.sensor) - order.begin();
  };
  std::stable_sort(report.findings.begin(), report.findings.end(),
                   [&rank](const Finding& a, const Finding& b) { return rank(a) < rank(b); });
}

}  // namespace

Report examine(const io::DatasetConfig& config, const Options& options) {
  Report report;
  report.dataset = config.path;
  const Reader reader = open(config, report);
  CheckInput c;
  check_rig(reader->rig(), c, report);
  check_left_out_cameras(config, reader->rig(), report);
  Collector collector(c.rig);
  read_all(*reader, options, collector, report);
  c.observed = collector.take();
  c.observed.streams = reader->report();
  c.observed.reference = reference_of(*reader, report);
  check_timing(c, report);
  check_imu(c, report);
  check_dvl(c, report);
  check_beams(c, report);
  check_depth(c, report);
  find_static_parts_of(config, options, c, report);
  check_cameras(c, report);
  check_motion(c, report);
  match_images_of(config, options, c, report);
  check_camera_motion(c, report);
  sort_by_sensor(report);
  return report;
}

}  // namespace apvi::doctor
