// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/sphere_camera.hpp"

#include <algorithm>
#include <array>
#include <vector>

#include "core/text.hpp"
#include "io/calibration/entry.hpp"

namespace apvi::io {
namespace {

using config::Node;

struct SphereModel {
  std::string_view theirs;
  std::string_view ours;
  std::size_t count;
  std::string_view intrinsics;
};

constexpr std::array<SphereModel, 3> kModels = {
    {{"ds", "double_sphere", 6, "xi, alpha, fu, fv, pu, pv"},
     {"eucm", "eucm", 6, "alpha, beta, fu, fv, pu, pv"},
     {"omni", "eucm", 5, "xi, fu, fv, pu, pv"}}};

void check_no_distortion(const Node& from, std::string_view path) {
  const auto k = find_entry(from, path, "distortion_coeffs");
  if (!k) return;
  const std::vector<double> numbers = numbers_of(*k);
  if (std::all_of(numbers.begin(), numbers.end(), [](double number) { return number == 0.0; }))
    return;
  fail_at(*k->node, k->key,
          "distortion besides this camera model is not supported; calibrate again as ds-none or "
          "eucm-none");
}

}  // namespace

bool set_sphere_camera(const Node& from, std::string_view path, Node& camera) {
  const auto name = find_entry(from, path, "camera_model");
  if (!name) return false;
  const std::string theirs = text::to_lower(word_of(*name));
  const auto* model = std::find_if(kModels.begin(), kModels.end(),
                                   [&](const SphereModel& m) { return m.theirs == theirs; });
  if (model == kModels.end()) return false;
  check_no_distortion(from, path);
  const Entry entry = require_entry(from, path, "intrinsics", model->intrinsics);
  std::vector<double> n = numbers_of(entry, model->count, model->intrinsics);
  if (theirs == "omni") {
    const double xi = n[0];
    n = {xi / (1.0 + xi), 1.0, n[1] / (1.0 + xi), n[2] / (1.0 + xi), n[3], n[4]};
  }
  camera.member("distortion") = word_at(model->ours, *name->node);
  camera.member("coefficients") = numbers_at({n[0], n[1]}, *entry.node);
  camera.member("intrinsics") = numbers_at({n[2], n[3], n[4], n[5]}, *entry.node);
  return true;
}

}  // namespace apvi::io
