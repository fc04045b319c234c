// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/waterlinked_log.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <utility>

#include "apvi/core/log.hpp"
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

class WaterLinkedLog : public SampleSource {
 public:
  WaterLinkedLog(std::unique_ptr<std::istream> in, std::string name, std::uint64_t size)
      : in_(std::move(in)), name_(std::move(name)), size_(size) {}

  SourceState next(SensorEvent& event) override {
    problem_ = {};
    while (std::getline(*in_, line_)) {
      ++line_number_;
      bytes_read_ += line_.size() + 1;
      const std::string_view line = text::trim(line_);
      if (line.empty() || line == "[" || line == "]") continue;  // an array has brackets
      const Json report = report_in(line);
      if (!report.is_object()) return refuse("no report in JSON");
      if (is_velocity(report)) return convert(report, event);
    }
    return SourceState::end;
  }
  std::string where() const override { return fmt::format("{}:{}", name_, line_number_); }
  std::pair<std::string, std::string> problem() const override { return problem_; }
  double fraction() const override {
    if (in_->eof()) return 1.0;
    if (size_ == 0) return 0.0;
    return std::min(1.0, static_cast<double>(bytes_read_) / static_cast<double>(size_));
  }

 private:
  // From the first to the last brace.
  static Json report_in(std::string_view line) {
    const std::size_t begin = line.find('{');
    const std::size_t end = line.rfind('}');
    if (begin == std::string_view::npos || end == std::string_view::npos || end < begin) return {};
    if (end - begin >= kMaxReport) return {};
    const std::string_view text = line.substr(begin, end - begin + 1);
    return Json::parse(text.begin(), text.end(), nullptr, false);
  }

  SourceState refuse(std::string kind) {
    constexpr std::size_t kMaxShown = 80;
    problem_ = {std::move(kind), line_.substr(0, kMaxShown)};
    for (char& c : problem_.second) c = static_cast<unsigned char>(c) < ' ' ? '?' : c;
    return SourceState::malformed;
  }

  SourceState convert(const Json& report, SensorEvent& event) {
    const auto us = number_in(report, "time_of_validity");
    if (!us || !(*us > 0.0 && *us <= kMaxStampUs)) return refuse("no time_of_validity");
    auto sample = sample_of(report);
    if (!sample) return refuse("no vx, vy, vz");
    sample->stamp = Stamp{1000 * std::llround(*us)};
    if (is_water_track(report) && !std::exchange(reported_water_, true)) {
      log::warning("{}: water track: velocities against the water are not used", where());
    }
    event = *sample;
    return SourceState::sample;
  }

  std::unique_ptr<std::istream> in_;
  std::string name_;
  std::uint64_t size_;
  std::uint64_t bytes_read_ = 0;
  std::size_t line_number_ = 0;
  std::string line_;
  std::pair<std::string, std::string> problem_;
  bool reported_water_ = false;
};

}  // namespace

std::unique_ptr<SampleSource> waterlinked_dvl(const std::filesystem::path& path) {
  std::error_code unknown;  // a pipe has no size
  const auto size = std::filesystem::file_size(path, unknown);
  return waterlinked_dvl(open_text(path), path.string(), unknown ? 0 : size);
}

std::unique_ptr<SampleSource> waterlinked_dvl(std::unique_ptr<std::istream> in, std::string name,
                                              std::uint64_t size) {
  return std::make_unique<WaterLinkedLog>(std::move(in), std::move(name), size);
}

}  // namespace apvi::io
