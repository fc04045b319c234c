// SPDX-License-Identifier: BSD-3-Clause
#include "runs/diff/diff_files.hpp"

#include <fmt/format.h>
#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>

#include "apvi/core/constants.hpp"
#include "core/atomic_file.hpp"
#include "eval/metrics_file.hpp"
#include "runs/diff/diff_images.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using eval::Json;

constexpr std::array<const char*, 3> kPlyColors = {"26 166 77", "214 38 41", "242 191 13"};

double rounded(double value) {
  return std::round(value * 1e4) / 1e4;
}

template <typename Values>
Json rounded_list(const Values& values) {
  return {rounded(values[0]), rounded(values[1]), rounded(values[2])};
}

Json color_json(const torch::Tensor& shown) {
  const torch::Tensor c = shown.to(torch::kCPU, torch::kFloat64);
  return {rounded(c[0].item<double>()), rounded(c[1].item<double>()), rounded(c[2].item<double>())};
}

torch::Tensor tensor_of(const std::array<double, 3>& light) {
  return torch::tensor({light[0], light[1], light[2]}, torch::kFloat32);
}

Eigen::Vector3d in_recording(const Eigen::Vector3d& point, const map_io::Origin& origin) {
  return point + Eigen::Vector3d(origin[0], origin[1], origin[2]);
}

Json change_json(const change::Change& c, std::size_t index, const map_io::Origin& origin,
                 const DiffColors& colors) {
  Json json = {
      {"id", index + 1},
      {"kind", change::to_string(c.kind)},
      {"center_m", rounded_list(in_recording(c.center, origin))},
      {"box_m",
       {rounded_list(in_recording(c.low, origin)), rounded_list(in_recording(c.high, origin))}},
      {"length_m", rounded(c.length_m)},
      {"width_m", rounded(c.width_m)},
      {"area_m2", rounded(c.area_m2)}};
  if (c.kind != change::Kind::color) {
    json["relief_m"] = rounded(c.relief_m);
    json["volume_m3"] = std::round(c.relief_m * c.area_m2 * 1e6) / 1e6;
  }
  json["views"] = c.views;
  json["confidence"] = rounded(c.confidence);
  if (c.before) json["color_before"] = color_json(colors.before(tensor_of(*c.before)));
  if (c.after) json["color_after"] = color_json(colors.after(tensor_of(*c.after)));
  if (c.factors) json["factors"] = rounded_list(*c.factors);
  if (c.moved_from) json["moved_from"] = *c.moved_from + 1;
  json["images"] = image_name(index, c.kind);
  return json;
}

double turn_deg(const torch::Tensor& R) {
  const double cosine = 0.5 * (R.trace().item<double>() - 1.0);
  return kDegreesPerRadian * std::acos(std::clamp(cosine, -1.0, 1.0));
}

std::size_t number_of(const change::ChangeMap& map, change::Kind kind) {
  return static_cast<std::size_t>(
      std::count_if(map.changes.begin(), map.changes.end(),
                    [kind](const change::Change& c) { return c.kind == kind; }));
}

Json summary_json(const DiffHeader& h, const change::ChangeMap& map) {
  const change::Registration& r = map.registration;
  return {{"before", h.before.string()},
          {"after", h.after.string()},
          {"min_size_m", h.min_size_m},
          {"cell_m", map.cell_m},
          {"plan_resolution_m", h.plan_m},
          {"counts",
           {{"appeared", number_of(map, change::Kind::appeared)},
            {"vanished", number_of(map, change::Kind::vanished)},
            {"color", number_of(map, change::Kind::color)}}},
          {"enough_views", {rounded(map.enough_views[0]), rounded(map.enough_views[1])}},
          {"compared_m2", rounded(map.compared_m2)},
          {"only_before_m2", rounded(map.only_before_m2)},
          {"only_after_m2", rounded(map.only_after_m2)},
          {"registration",
           {{"shift_m", rounded(r.shift_m)},
            {"turn_deg", rounded(turn_deg(r.R))},
            {"deformation_m", rounded(r.deformation_m)},
            {"residual_m", rounded(r.residual_m)}}},
          {"color_transfer",
           {{"slope", rounded_list(map.color_slope)}, {"offset", rounded_list(map.color_offset)}}}};
}

void write_json(const fs::path& folder, const DiffHeader& header, const DiffSessions& sessions,
                const change::ChangeMap& map, const DiffColors& colors) {
  Json json = summary_json(header, map);
  json["changes"] = Json::array();
  for (std::size_t i = 0; i < map.changes.size(); ++i) {
    json["changes"].push_back(change_json(map.changes[i], i, sessions.origin, colors));
  }
  write_file_atomically(folder / "changes.json",
                        [&json](std::ostream& out) { out << json.dump(1) << '\n'; });
}

void write_csv(const fs::path& folder, const DiffSessions& sessions, const change::ChangeMap& map) {
  write_file_atomically(folder / "changes.csv", [&](std::ostream& out) {
    out << "#id,kind,x [m],y [m],z [m],length [m],width [m],area [m^2],relief "
           "[m],views,confidence\n";
    for (std::size_t i = 0; i < map.changes.size(); ++i) {
      const change::Change& c = map.changes[i];
      const Eigen::Vector3d p = in_recording(c.center, sessions.origin);
      out << fmt::format("{},{},{:.4f},{:.4f},{:.4f},{:.4f},{:.4f},{:.5f},{:.4f},{:.0f},{:.3f}\n",
                         i + 1, change::to_string(c.kind), p.x(), p.y(), p.z(), c.length_m,
                         c.width_m, c.area_m2, c.relief_m, c.views, c.confidence);
    }
  });
}

void write_ply(const fs::path& folder, const DiffSessions& sessions, const change::ChangeMap& map) {
  std::int64_t count = 0;
  for (const change::Change& c : map.changes) count += c.points.size(0);
  write_file_atomically(folder / "changes.ply", [&](std::ostream& out) {
    out << fmt::format(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\n"
        "property double z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
        "property int change\nend_header\n",
        count);
    for (std::size_t i = 0; i < map.changes.size(); ++i) {
      const change::Change& c = map.changes[i];
      const torch::Tensor p = c.points.to(torch::kCPU, torch::kFloat64).contiguous();
      for (std::int64_t row = 0; row < p.size(0); ++row) {
        const double* x = p.data_ptr<double>() + 3 * row;
        out << fmt::format("{:.4f} {:.4f} {:.4f} {} {}\n", x[0] + sessions.origin[0],
                           x[1] + sessions.origin[1], x[2] + sessions.origin[2],
                           kPlyColors.at(static_cast<std::size_t>(c.kind)), i + 1);
      }
    }
  });
}

}  // namespace

void write_change_files(const fs::path& folder, const DiffHeader& header,
                        const DiffSessions& sessions, const change::ChangeMap& map,
                        const DiffColors& colors) {
  write_json(folder, header, sessions, map, colors);
  write_csv(folder, sessions, map);
  write_ply(folder, sessions, map);
}

}  // namespace apvi::runs
