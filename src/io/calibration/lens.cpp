// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/lens.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <stdexcept>
#include <string>

#include "apvi/sensors/lens.hpp"
#include "core/text.hpp"

namespace apvi::io {
namespace {

using config::Node;

const std::map<std::string, Distortion>& lens_names() {
  static const std::map<std::string, Distortion> names = {
      {"", Distortion::none},
      {"none", Distortion::none},
      {"radtan", Distortion::radtan},
      {"radial-tangential", Distortion::radtan},
      {"plumb_bob", Distortion::radtan},
      {"rational_polynomial", Distortion::radtan},
      {"pinhole", Distortion::radtan},
      {"equi", Distortion::equidistant},
      {"equidistant", Distortion::equidistant},
      {"fisheye", Distortion::equidistant},
      {"kannalabrandt8", Distortion::equidistant}};
  return names;
}

[[noreturn]] void fail_lens(const Entry& entry, const Entry& model, const std::vector<double>& k,
                            std::string_view what) {
  fail_at(*entry.node, entry.key,
          fmt::format("lens {} with coefficients [{}]: {}; calibrate again as radtan or, for a "
                      "wide lens, as equidistant, double sphere or EUCM, or undistort the images",
                      model.node->text, fmt::join(k, ", "), what));
}

// OpenCV's order after k1, k2, p1, p2 is k3, k4, k5, k6, then thin prism and tilt, which are not
// modeled. Fills up to a number of coefficients that radtan takes.
void complete_radtan(const Entry& entry, const Entry& model, std::vector<double>& k) {
  for (std::size_t i = CameraModel::kMaxCoefficients; i < k.size(); ++i) {
    if (k[i] == 0.0) continue;
    fail_lens(entry, model, k, fmt::format("number {} is not 0, and is not modeled", i + 1));
  }
  if (k.size() > 5) k.resize(CameraModel::kMaxCoefficients);
}

}  // namespace

void check_pinhole(const Entry& model) {
  if (text::to_lower(word_of(model)) == "pinhole") return;
  fail_at(*model.node, model.key,
          fmt::format("the camera model {} is not supported; expected pinhole, or of Kalibr ds, "
                      "eucm, or omni without distortion",
                      model.node->text));
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
  std::vector<double> k = coefficients;
  if (name->second == Distortion::radtan) complete_radtan(place, model, k);
  CameraModel::Parameters lens;
  try {
    apvi::set_lens(name->second, k, lens);
  } catch (const std::invalid_argument& e) {
    fail_lens(place, model, k, e.what());
  }
  camera.member("distortion") = word_at(lens_name(lens.distortion), *model.node);
  camera.member("coefficients") = numbers_at(coefficients_of(lens), *place.node);
}

void set_lens_of(const Node& from, std::string_view path, std::string_view coefficients,
                 Node& camera) {
  const auto numbers = find_entry(from, path, coefficients);
  if (!numbers && !find_entry(from, path, "distortion_model")) return;
  const Entry model = require_entry(from, path, "distortion_model", "radtan or equidistant");
  const bool plain = !numbers && text::to_lower(word_of(model)) == "none";
  const Entry place =
      plain ? model : require_entry(from, path, coefficients, "the coefficients of the lens");
  set_lens(model, place, plain ? std::vector<double>{} : numbers_of(place), camera);
}

}  // namespace apvi::io
