// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/lens.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <string>

#include "core/text.hpp"

namespace apvi::io {
namespace {

using config::Node;

constexpr std::size_t kCoefficients = 4;

const std::map<std::string, std::string>& lens_names() {
  static const std::map<std::string, std::string> names = {{"", "none"},
                                                           {"none", "none"},
                                                           {"radtan", "radtan"},
                                                           {"radial-tangential", "radtan"},
                                                           {"plumb_bob", "radtan"},
                                                           {"rational_polynomial", "radtan"},
                                                           {"pinhole", "radtan"},
                                                           {"equi", "equidistant"},
                                                           {"equidistant", "equidistant"},
                                                           {"fisheye", "equidistant"},
                                                           {"kannalabrandt8", "equidistant"}};
  return names;
}

// Name of a camera model for people; empty when it is not known.
std::string_view full_name(const std::string& model) {
  static const std::map<std::string, std::string_view> names = {
      {"omni", "omnidirectional (Mei)"}, {"mei", "omnidirectional (Mei)"},
      {"ds", "double sphere"},           {"eucm", "extended unified camera model"},
      {"ucm", "unified camera model"},   {"kb4", "Kannala-Brandt"},
  };
  const auto it = names.find(model);
  return it == names.end() ? std::string_view{} : it->second;
}

void fail_lens(const Entry& entry, const Entry& model, const std::vector<double>& k,
               std::string_view what) {
  fail_at(*entry.node, entry.key,
          fmt::format("lens {} with coefficients [{}]: {}; calibrate again with k1, k2, p1, p2 "
                      "only or, for a wide lens, with equidistant, or undistort the images",
                      model.node->text, fmt::join(k, ", "), what));
}

// OpenCV's order after k1, k2, p1, p2: k3 of the polynomial, and k4, k5, k6 of its denominator.
void drop_zeros(const Entry& entry, const Entry& model, std::vector<double>& k) {
  for (std::size_t i = kCoefficients; i < k.size(); ++i) {
    if (k[i] == 0.0) continue;
    const std::string name = i < 8 ? fmt::format("k{}", i - 1) : fmt::format("number {}", i + 1);
    fail_lens(entry, model, k, fmt::format("{} is not 0, and is not modeled", name));
  }
  k.resize(std::min(k.size(), kCoefficients));
}

}  // namespace

void check_pinhole(const Entry& model) {
  const std::string name = text::to_lower(word_of(model));
  if (name == "pinhole") return;
  const std::string_view full = full_name(name);
  fail_at(*model.node, model.key,
          fmt::format("the camera model {}{} is not supported; expected pinhole: calibrate a wide "
                      "lens as pinhole with equidistant distortion (Kalibr: pinhole-equi)",
                      model.node->text, full.empty() ? "" : fmt::format(", {},", full)));
}

void set_lens(const Entry& model, const Entry& coefficients, Node& camera) {
  set_lens(model, coefficients, numbers_of(coefficients), camera);
}

void set_lens(const Entry& model, const Entry& place, const std::vector<double>& coefficients,
              Node& camera) {
  const auto name = lens_names().find(text::to_lower(word_of(model)));
  if (name == lens_names().end()) {
    fail_lens(model, model, coefficients, "the lens model is not supported");
  }
  const std::string& distortion = name->second;
  std::vector<double> k = coefficients;
  if (distortion == "radtan") drop_zeros(place, model, k);
  if (distortion != "none" && k.size() != kCoefficients) {
    fail_lens(place, model, k, fmt::format("expected {} coefficients", kCoefficients));
  }
  if (distortion == "none") {
    if (std::any_of(k.begin(), k.end(), [](double number) { return number != 0.0; })) {
      fail_lens(place, model, k, "expected no coefficients");
    }
    k.clear();
  }
  camera.member("distortion") = word_at(distortion, *model.node);
  camera.member("coefficients") = numbers_at(k, *place.node);
}

void set_lens_of(const Node& from, std::string_view path, std::string_view coefficients,
                 Node& camera) {
  const auto numbers = find_entry(from, path, coefficients);
  if (!numbers && !find_entry(from, path, "distortion_model")) return;
  const Entry model = require_entry(from, path, "distortion_model", "radtan or equidistant");
  const bool plain = !numbers && text::to_lower(word_of(model)) == "none";
  const Entry place =
      plain ? model : require_entry(from, path, coefficients, "four coefficients of the lens");
  set_lens(model, place, plain ? std::vector<double>{} : numbers_of(place), camera);
}

}  // namespace apvi::io
