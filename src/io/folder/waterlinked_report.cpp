// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/waterlinked_report.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

#include "core/text.hpp"
#include "io/folder/csv_file.hpp"
#include "io/folder/dvl_validity.hpp"

namespace apvi::io {
namespace {

using Json = nlohmann::json;

constexpr std::size_t kMaxReport = std::size_t{64} * 1024;  // [bytes]
constexpr double kMaxStampUs = 1e-3 * static_cast<double>(kMaxStampNs);

std::optional<double> number_in(const Json& object, const char* key) {
  const auto it = object.find(key);
  if (it == object.end() || !it->is_number()) return std::nullopt;
  return it->get<double>();
}

bool is_true(const Json& object, const char* key) {
  const auto it = object.find(key);
  if (it == object.end()) return false;
  return it->is_boolean() ? it->get<bool>() : number_in(object, key).value_or(0.0) != 0.0;
}

std::string text_in(const Json& object, const char* key) {
  const auto it = object.find(key);
  return it != object.end() && it->is_string() ? it->get<std::string>() : std::string();
}

// The first versions of the protocol did not name the kind of a report.
bool is_velocity(const Json& report) {
  const std::string type = text_in(report, "type");
  return type.empty() ? report.contains("vx") : type == "velocity" || type == "velocity_water";
}

bool is_water_track(const Json& report) {
  return text_in(report, "type") == "velocity_water" || text_in(report, "tracking_mode") == "water";
}

void add_beams(const Json& report, DvlSample& sample) {
  const auto beams = report.find("transducers");
  if (beams == report.end() || !beams->is_array()) return;
  for (const Json& beam : *beams) {
    const double id = number_in(beam, "id").value_or(-1.0);
    const auto velocity = number_in(beam, "velocity");
    if (!velocity || !(id >= 0.0 && id < static_cast<double>(kDvlBeams))) continue;
    sample.beams[static_cast<std::size_t>(id)] = DvlBeam{.velocity = *velocity,
                                                         .range = number_in(beam, "distance"),
                                                         .valid = is_true(beam, "beam_valid")};
  }
}

// nullopt without a velocity, which only an invalid report may lack.
std::optional<DvlSample> sample_of(const Json& report) {
  const auto x = number_in(report, "vx");
  const auto y = number_in(report, "vy");
  const auto z = number_in(report, "vz");
  DvlSample sample;
  sample.valid = is_true(report, "velocity_valid");
  if (sample.valid && (!x || !y || !z)) return std::nullopt;
  sample.velocity = {x.value_or(0.0), y.value_or(0.0), z.value_or(0.0)};
  sample.valid = sample.valid && !is_water_track(report);
  sample.figure_of_merit = number_in(report, "fom");
  sample.altitude = number_in(report, "altitude");
  add_beams(report, sample);
  clear_placeholder_values(sample);
  return sample;
}

// From the first to the last brace.
Json report_in(std::string_view line) {
  const std::size_t begin = line.find('{');
  const std::size_t end = line.rfind('}');
  if (begin == std::string_view::npos || end == std::string_view::npos || end < begin) return {};
  if (end - begin >= kMaxReport) return {};
  const std::string_view text = line.substr(begin, end - begin + 1);
  return Json::parse(text.begin(), text.end(), nullptr, false);
}

std::optional<Stamp> stamp_in(const Json& report, const char* key) {
  const auto us = number_in(report, key);
  if (!us || !(*us > 0.0 && *us <= kMaxStampUs)) return std::nullopt;
  return Stamp{1000 * std::llround(*us)};
}

WaterLinkedReport malformed(std::string problem) {
  WaterLinkedReport report;
  report.problem = std::move(problem);
  return report;
}

WaterLinkedReport velocity_of(const Json& json) {
  const auto stamp = stamp_in(json, "time_of_validity");
  if (!stamp) return malformed("no time_of_validity");
  WaterLinkedReport report;
  report.sample = sample_of(json);
  if (!report.sample) return malformed("no vx, vy, vz");
  report.sample->stamp = *stamp;
  report.sent = stamp_in(json, "time_of_transmission");
  report.water_track = is_water_track(json);
  return report;
}

std::optional<WaterLinkedSettings> settings_in(const Json& report) {
  if (text_in(report, "response_to") != "get_config") return std::nullopt;
  const auto result = report.find("result");
  if (result == report.end() || !result->is_object()) return std::nullopt;
  return WaterLinkedSettings{
      .speed_of_sound_m_s = number_in(*result, "speed_of_sound"),
      .mounting_rotation_deg = number_in(*result, "mounting_rotation_offset")};
}

}  // namespace

WaterLinkedReport parse_waterlinked(std::string_view line) {
  line = text::trim(line);
  if (line.empty() || line == "[" || line == "]") return {};  // an array has brackets
  const Json json = report_in(line);
  if (!json.is_object()) return malformed("no report in JSON");
  if (is_velocity(json)) return velocity_of(json);
  WaterLinkedReport report;
  report.settings = settings_in(json);
  return report;
}

}  // namespace apvi::io
