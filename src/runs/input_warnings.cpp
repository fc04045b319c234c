// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <utility>

#include "apvi/core/log.hpp"
#include "runs/warnings.hpp"

namespace apvi::runs {
namespace {

using localization::ImageCounts;
using Warnings = std::vector<std::string>;
using Verdicts = std::map<dipo::Verdict, std::size_t>;

std::size_t count_of(const Verdicts& verdicts, dipo::Verdict verdict) {
  const auto found = verdicts.find(verdict);
  return found == verdicts.end() ? 0 : found->second;
}

std::size_t used_of(const Verdicts& verdicts) {
  return count_of(verdicts, dipo::Verdict::accepted) +
         count_of(verdicts, dipo::Verdict::downweighted);
}

// "12 rejected, 3 no_lock"
std::string list_of(const Verdicts& verdicts) {
  std::string list;
  for (const auto& [verdict, count] : verdicts) {
    list += fmt::format("{}{} {}", list.empty() ? "" : ", ", count, dipo::to_string(verdict));
  }
  return list;
}

std::string choice_of(const std::string& kind) {
  return kind == "depth" ? "pressure" : kind;
}

bool in_use(const Evidence& evidence, const std::string& kind) {
  const auto& use = evidence.sensors_in_use;
  return std::find(use.begin(), use.end(), choice_of(kind)) != use.end();
}

std::size_t dropped_for(const io::StreamReport& report, io::DropReason reason) {
  const auto found = report.dropped.find(reason);
  return found == report.dropped.end() ? 0 : found->second;
}

void check_stream(const std::string& kind, const io::StreamReport& report, Warnings& warnings) {
  std::size_t dropped = 0;
  std::string reasons;
  for (const auto& [reason, count] : report.dropped) {
    dropped += count;
    const auto first = report.first_drop.find(reason);
    reasons += fmt::format("{}{} {}", reasons.empty() ? "" : ", ", count, to_string(reason));
    if (first != report.first_drop.end()) reasons += fmt::format(" (first: {})", first->second);
  }
  if (report.delivered + dropped == 0) {
    if (!report.remark.empty()) return;  // it was left out, which is said
    warnings.push_back(fmt::format("{}: recorded without a sample; check the file or topic", kind));
  } else if (dropped > report.delivered) {
    warnings.push_back(fmt::format("{}: {} of {} samples were dropped: {}; check the recording",
                                   kind, dropped, dropped + report.delivered, reasons));
  }
}

// Single samples out of order do no harm; many are a clock. Returns whether they are.
bool check_clock_of(const std::string& kind, const io::StreamReport& report, Warnings& warnings) {
  constexpr std::size_t kMany = 5;
  constexpr double kStep_s = 0.2;
  const std::size_t jumped = dropped_for(report, io::DropReason::broken_stamp);
  if (jumped >= kMany) {
    warnings.push_back(fmt::format(
        "{}: {} samples were dropped, as their stamps jump away from those before while other "
        "sensors continue: its clock was set; check the recording",
        kind, jumped));
  }
  const std::size_t back = dropped_for(report, io::DropReason::out_of_order);
  const double step_s = report.largest_step_back.seconds();
  if (back < kMany || step_s < kStep_s) return jumped >= kMany;
  warnings.push_back(fmt::format(
      "{}: {} samples lie up to {:.1f} s before earlier ones and were dropped (first: {}): if its "
      "clock was set back, the stamps after it do not fit the other sensors; check the recording",
      kind, back, step_s, report.first_drop.at(io::DropReason::out_of_order)));
  return true;
}

void check_described(const Evidence& evidence, const Rig& rig, Warnings& warnings) {
  const std::vector<std::pair<std::string, bool>> described = {
      {"dvl", rig.dvl.has_value()},
      {"pressure", rig.pressure.has_value()},
      {"depth", rig.depth.has_value()}};
  for (const auto& [kind, known] : described) {
    const auto stream = evidence.streams.find(kind);
    if (known || !in_use(evidence, kind) || stream == evidence.streams.end()) continue;
    if (stream->second.delivered == 0) continue;
    warnings.push_back(
        fmt::format("{0}: recorded, but unused: the rig does not describe {0}0; add it, or remove "
                    "{1} from sensors.use",
                    kind, choice_of(kind)));
  }
}

void check_images(const ImageCounts& counts, std::size_t camera, Warnings& warnings) {
  if (counts.images == 0 || 2 * counts.unusable() <= counts.images) return;
  std::string text = fmt::format("cam{}: {} of {} images could not be used:", camera,
                                 counts.unusable(), counts.images);
  if (counts.undecodable > 0) {
    text +=
        fmt::format(" {} not decodable (first: {});", counts.undecodable, counts.first_undecodable);
  }
  if (counts.wrong_size > 0) {
    text += fmt::format(
        " {} of the wrong size ({}): calibrate at the size of the images, or scale fx, fy, cx, cy "
        "and resolution in the rig",
        counts.wrong_size, counts.first_wrong_size);
  } else {
    text += " export the images again, or look at them";
  }
  warnings.push_back(std::move(text));
}

constexpr const char* kKnownLength = ". If you know a length in the scene: apvi scale";

void check_scale(const Evidence& evidence, Warnings& warnings) {
  if (!has_unknown_scale(evidence)) return;
  if (evidence.streams.contains("imu")) {
    warnings.push_back(fmt::format(
        "scale: unknown, as the IMU did not show it: visual-inertial odometry never initialized "
        "and waited for {}; distances are in a unit in which the first scene is "
        "vio.visual.start_distance away{}",
        evidence.vio->waiting_for.empty() ? "more images" : evidence.vio->waiting_for,
        kKnownLength));
  } else if (evidence.streams.contains("dvl")) {
    warnings.push_back(
        "scale: unknown, as too few velocities of the DVL agree with the images; check its "
        "mounting and its stamps with `apvi doctor`");
  } else if (evidence.streams.contains("pressure") || evidence.streams.contains("depth")) {
    warnings.push_back(fmt::format(
        "scale: unknown, as the depth did not show it: without an IMU the camera must move up and "
        "down and in both horizontal directions{}",
        kKnownLength));
  }
}

// Whether most images show nothing, which is no matter of the calibration.
bool check_uniform(const VioService& vio, Warnings& warnings) {
  constexpr double kBlack = 10.0;  // mean gray value
  if (vio.uniform == 0 || 2 * vio.uniform <= vio.frames) return false;
  const double gray = vio.uniform_gray / static_cast<double>(vio.uniform);
  warnings.push_back(fmt::format(
      "vio: {} of {} images are {} (mean gray value {:.0f} of 255): look at the images, their "
      "exposure and encoding, and at lamp and lens cover",
      vio.uniform, vio.frames, gray < kBlack ? "black" : "uniform, without structure", gray));
  return true;
}

// Darkness and silt take less than this part of the images of a dive that is worth mapping.
constexpr double kMinUsedFrames = 0.2;

void check_vio(const VioService& vio, Warnings& warnings) {
  if (check_uniform(vio, warnings) && vio.used == 0) return;
  if (vio.frames == 0) {
    warnings.push_back("vio: no image reached it; check the stamps of camera and IMU");
  } else if (vio.with_pose == 0) {
    warnings.push_back(fmt::format(
        "vio: never initialized in {} frames; at the end it waited for {}; look at health.csv and "
        "at the image rate and the camera's calibration with `apvi doctor`",
        vio.frames, vio.waiting_for));
  } else if (vio.used == 0) {
    warnings.push_back(fmt::format(
        "vio: none of its {} poses was accepted by failure detection; look at the reasons in "
        "health.csv and at the camera's calibration with `apvi doctor`",
        vio.with_pose));
  } else if (static_cast<double>(vio.used) < kMinUsedFrames * static_cast<double>(vio.frames)) {
    warnings.push_back(fmt::format(
        "vio: the poses of only {} of {} images were used; look at the reasons in health.csv, and "
        "at the image rate and the camera's calibration with `apvi doctor`",
        vio.used, vio.frames));
  }
}

void check_acoustic(const AcousticService& acoustic, Warnings& warnings) {
  const Verdicts& pings = acoustic.counts.pings;
  if (!acoustic.waiting_for.empty()) {
    warnings.push_back(fmt::format(
        "dvl: at the end odometry was not initialized and waited for {}; check bottom lock and the "
        "stamps of DVL and IMU with `apvi doctor`",
        acoustic.waiting_for));
  } else if (used_of(pings) == 0) {
    warnings.push_back(
        fmt::format("dvl: no ping was used ({}); check the DVL's mounting, units and validity with "
                    "`apvi doctor`",
                    pings.empty() ? "none reported" : list_of(pings)));
  }
  const Verdicts& depths = acoustic.counts.depths;
  if (depths.empty() || used_of(depths) > 0) return;
  warnings.push_back(
      fmt::format("pressure: no sample was used ({}); check its unit and stamps with `apvi doctor`",
                  list_of(depths)));
}

std::string length_text(double length_s) {
  constexpr double kDay = 86400.0;
  return length_s < kDay ? fmt::format("{:.1f} s", length_s)
                         : fmt::format("{:.1f} days", length_s / kDay);
}

// One warning for each of the first pauses, as the trajectory has a break there.
void check_pauses(const SampleStatistics& samples, Warnings& warnings) {
  constexpr std::size_t kMaxWarnings = 5;
  const auto& pauses = samples.pauses();
  for (std::size_t i = 0; i < std::min(pauses.size(), kMaxWarnings); ++i) {
    const double since_s = seconds_between(*samples.first(), pauses[i].since);
    warnings.push_back(fmt::format(
        "imu: no samples for {} after {:.2f} s{}: a new segment begins there; its heading and "
        "position relative to the last one are uncertain",
        length_text(pauses[i].length_s), since_s,
        pauses[i].length_s < 86400.0 ? "" : " (or the clock was set)"));
  }
  if (pauses.size() <= kMaxWarnings) return;
  warnings.push_back(fmt::format("imu: {} more pauses", pauses.size() - kMaxWarnings));
}

}  // namespace

void VioService::add_image(const vio::FrameStatistics& image) {
  if (image.quality != vio::FrameQuality::featureless) return;
  ++uniform;
  uniform_gray += image.brightness;
}

std::vector<std::string> check_inputs(const Evidence& evidence, const Rig& rig) {
  Warnings warnings;
  for (const auto& [kind, report] : evidence.streams) {
    if (!in_use(evidence, kind)) continue;
    if (!report.remark.empty()) warnings.push_back(report.remark);
    if (!check_clock_of(kind, report, warnings)) check_stream(kind, report, warnings);
  }
  check_described(evidence, rig, warnings);
  check_pauses(evidence.samples, warnings);
  for (std::size_t i = 0; i < evidence.images.size(); ++i) {
    check_images(evidence.images[i], i, warnings);
  }
  if (evidence.vio) check_vio(*evidence.vio, warnings);
  check_scale(evidence, warnings);
  if (evidence.acoustic) check_acoustic(*evidence.acoustic, warnings);
  return warnings;
}

bool has_unknown_scale(const VioService& vio) {
  return vio.with_pose > 0 && vio.up_to_scale == vio.with_pose;
}

bool has_unknown_scale(const Evidence& evidence) {
  return evidence.vio && !dipo_served(evidence) && has_unknown_scale(*evidence.vio);
}

bool vio_served(const Evidence& evidence) {
  return evidence.vio && evidence.vio->used > 0;
}

bool dipo_served(const Evidence& evidence) {
  return evidence.acoustic && used_of(evidence.acoustic->counts.pings) > 0;
}

}  // namespace apvi::runs
