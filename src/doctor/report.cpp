// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/report.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace apvi::doctor {
namespace {

constexpr std::size_t kLineLength = 110;
constexpr std::size_t kTextColumn = 31;  // start column of messages

// Appends words to `out`, wrapped at kLineLength with indented continuation lines.
void append_wrapped(std::string& out, std::string_view words, std::string_view lead) {
  std::string line(lead);
  std::size_t at = 0;
  while (at < words.size()) {
    std::size_t end = words.find(' ', at);
    if (end == std::string_view::npos) end = words.size();
    const std::string_view word = words.substr(at, end - at);
    const bool first = line.size() <= kTextColumn;
    if (!first && line.size() + 1 + word.size() > kLineLength) {
      out += line + "\n";
      line = std::string(kTextColumn, ' ') + std::string(word);
    } else {
      if (!first && line.back() != ' ') line += ' ';
      line += word;
    }
    at = end + 1;
  }
  out += line + "\n";
}

void append(std::string& out, const Finding& f) {
  const std::string lead = fmt::format("  {:<8} {:<19} ", to_string(f.severity), f.check);
  append_wrapped(out, f.message, lead);
  if (!f.advice.empty()) append_wrapped(out, f.advice, std::string(kTextColumn - 3, ' ') + "-> ");
}

std::vector<std::string> sensors_of(const Report& report) {
  std::vector<std::string> sensors;
  for (const Finding& f : report.findings) {
    if (std::find(sensors.begin(), sensors.end(), f.sensor) == sensors.end()) {
      sensors.push_back(f.sensor);
    }
  }
  return sensors;
}

std::string plural(std::size_t count, const char* what) {
  return fmt::format("{} {}{}", count, what, count == 1 ? "" : "s");
}

}  // namespace

std::string_view to_string(Severity severity) {
  switch (severity) {
    case Severity::ok:
      return "ok";
    case Severity::note:
      return "note";
    case Severity::warning:
      return "warning";
    case Severity::error:
      return "error";
  }
  return "unknown";
}

std::size_t Report::count(Severity severity) const {
  return static_cast<std::size_t>(
      std::count_if(findings.begin(), findings.end(),
                    [severity](const Finding& f) { return f.severity == severity; }));
}

bool Report::has_error(std::string_view sensor) const {
  return std::any_of(findings.begin(), findings.end(), [sensor](const Finding& f) {
    return f.sensor == sensor && f.severity == Severity::error;
  });
}

const Finding* Report::find(std::string_view sensor, std::string_view check) const {
  for (const Finding& f : findings) {
    if (f.sensor == sensor && f.check == check) return &f;
  }
  return nullptr;
}

std::string to_text(const Report& report) {
  std::string out = report.dataset + "\n";
  for (const std::string& sensor : sensors_of(report)) {
    out += "\n" + sensor + "\n";
    for (const Finding& f : report.findings) {
      if (f.sensor == sensor) append(out, f);
    }
  }
  out += fmt::format("\n{}, {}, {}\n", plural(report.count(Severity::error), "error"),
                     plural(report.count(Severity::warning), "warning"),
                     plural(report.count(Severity::note), "note"));
  return out;
}

std::string to_json(const Report& report) {
  nlohmann::ordered_json findings = nlohmann::ordered_json::array();
  for (const Finding& f : report.findings) {
    nlohmann::ordered_json values = nlohmann::ordered_json::object();
    for (const auto& [name, value] : f.values) values[name] = value;  // NaN is written as null
    findings.push_back({{"sensor", f.sensor},
                        {"check", f.check},
                        {"severity", to_string(f.severity)},
                        {"message", f.message},
                        {"advice", f.advice},
                        {"values", values}});
  }
  const nlohmann::ordered_json root = {{"dataset", report.dataset},
                                       {"errors", report.count(Severity::error)},
                                       {"warnings", report.count(Severity::warning)},
                                       {"findings", findings}};
  // Paths may contain bytes that are not UTF-8.
  return root.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace apvi::doctor
