// SPDX-License-Identifier: BSD-3-Clause
#include "runs/views/dive_view.hpp"

#include <algorithm>
#include <array>
#include <filesystem>
#include <string_view>
#include <utility>

#include "apvi/core/log.hpp"
#include "apvi/io/sequence.hpp"

namespace apvi::runs {
namespace {

constexpr std::array<std::string_view, 5> kShown = {"camera", "imu", "dvl", "pressure", "depth"};
constexpr double kVisibleGap = 1.0 / 2000.0;  // of the dive: less than a pixel of the timeline
constexpr double kPlainLength_m = 1.0;        // of beams without range and altitude
constexpr double kMaxLength_m = 1000.0;
constexpr double kMinCosine = 0.2;  // between a beam and the axis of all of them

double length_s(const std::vector<SensorSpan>& spans) {
  if (spans.empty()) return 0.0;
  Stamp first = spans.front().begin;
  Stamp last = spans.front().end;
  for (const SensorSpan& span : spans) {
    first = std::min(first, span.begin);
    last = std::max(last, span.end);
  }
  return seconds_between(first, last);
}

void add_span(const SensorSpan& span, double min_gap_s, viewer::SensorTrack& track) {
  if (!track.spans.empty() && seconds_between(track.spans.back().second, span.begin) < min_gap_s) {
    track.spans.back().second = span.end;
  } else {
    track.spans.emplace_back(span.begin, span.end);
  }
}

Eigen::Vector3d axis_of(const DvlCalibration& dvl) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& beam : dvl.beams) sum += beam;
  return sum.normalized();
}

bool has(const std::optional<double>& distance) {
  return distance && *distance > 0.0;
}

}  // namespace

std::vector<viewer::LoopLine> shown_loops(const std::vector<loop_closure::ClosedLoop>& loops) {
  std::vector<viewer::LoopLine> lines;
  for (const loop_closure::ClosedLoop& loop : loops) lines.push_back({loop.from, loop.to});
  return lines;
}

std::vector<viewer::SensorTrack> shown_sensors(const std::vector<SensorSpan>& spans) {
  const double min_gap_s = kVisibleGap * length_s(spans);
  std::vector<viewer::SensorTrack> tracks;
  for (const std::string_view name : kShown) {
    viewer::SensorTrack track{std::string(name), {}};
    for (const SensorSpan& span : spans) {
      if (span.sensor == name) add_span(span, min_gap_s, track);
    }
    if (!track.spans.empty()) tracks.push_back(std::move(track));
  }
  return tracks;
}

viewer::Beams shown_beams(const DvlCalibration& dvl) {
  return {.T_body_dvl = dvl.T_body_dvl, .directions = dvl.beams, .pings = {}};
}

viewer::BeamPing shown_ping(const DvlSample& ping, const DvlCalibration& dvl) {
  viewer::BeamPing shown{};
  shown.stamp = ping.stamp - Duration::from_seconds(dvl.time_offset_s);
  const Eigen::Vector3d axis = axis_of(dvl);
  for (std::size_t i = 0; i < viewer::kBeams; ++i) {
    const std::optional<DvlBeam>& beam = ping.beams.at(i);
    const double cosine = std::max(kMinCosine, axis.dot(dvl.beams.at(i)));
    double length_m = has(ping.altitude) ? dvl.scale * *ping.altitude / cosine : kPlainLength_m;
    shown.measured.at(i) = beam && has(beam->range);
    if (shown.measured.at(i)) length_m = dvl.scale * *beam->range;
    shown.length_m.at(i) = std::min(length_m, kMaxLength_m);
    shown.valid.at(i) = beam ? beam->valid : ping.valid;
  }
  return shown;
}

std::optional<viewer::Beams> read_beams(const RunConfig& config,
                                        const std::function<bool()>& interrupted) {
  try {
    const Rig rig = make_rig(config.rig);
    if (!rig.dvl || !std::filesystem::exists(config.dataset.path)) return std::nullopt;
    const auto recording = io::open_sequence(config.dataset, {"dvl"});
    viewer::Beams beams = shown_beams(*rig.dvl);
    while (const auto event = recording->next()) {
      if (interrupted()) return std::nullopt;
      if (const auto* ping = std::get_if<DvlSample>(&*event)) {
        beams.pings.push_back(shown_ping(*ping, *rig.dvl));
      }
    }
    if (beams.pings.empty()) return std::nullopt;
    return beams;
  } catch (const std::exception& error) {  // the map is worth seeing all the same
    log::debug("no beams of the DVL: {}", error.what());
    return std::nullopt;
  }
}

}  // namespace apvi::runs
