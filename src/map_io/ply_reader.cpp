// SPDX-License-Identifier: BSD-3-Clause
#include <torch/torch.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "gaussians/model/point_cloud.hpp"
#include "map_io/compressed_ply.hpp"
#include "map_io/map_comments.hpp"
#include "map_io/ply.hpp"
#include "map_io/ply_table.hpp"
#include "map_io/splat_tensors.hpp"
#include "map_io/splats.hpp"

namespace apvi::map_io {
namespace {

namespace fs = std::filesystem;
using torch::Tensor;
using Columns = std::vector<PlyColumn>;

// Log scale [m] of the missing axis of flat Gaussians (2D Gaussian splatting).
constexpr double kFlatLogScale = -13.8;  // a micrometer
constexpr int kMaxFileDegree = 10;       // of SH; a larger number of coefficients is an error

const char* const kPosition[] = {"x", "y", "z"};
const char* const kColor[] = {"red", "green", "blue"};

std::string indexed_name(const char* name, std::int64_t i) {
  return name + std::to_string(i);
}

/// A contiguous float tensor [N, count] from properties name0, name1, ….
void add_columns(Columns& columns, const PlyTable& table, const char* name, Tensor& tensor) {
  const std::int64_t count = tensor.size(1);
  for (std::int64_t i = 0; i < count; ++i) {
    const auto property = table.find(indexed_name(name, i));
    if (!property) continue;  // the third scale of flat Gaussians
    columns.push_back({.property = *property, .to = tensor.data_ptr<float>() + i, .stride = count});
  }
}

void add_position_columns(Columns& columns, const PlyTable& table, Tensor& means,
                          const Origin& offset = {}) {
  for (std::size_t i = 0; i < 3; ++i) {
    columns.push_back({.property = table.require_property(kPosition[i]),
                       .to = means.data_ptr<float>() + i,
                       .stride = 3,
                       .offset = offset[i]});
  }
}

bool has_byte_colors(const PlyTable& table) {
  const auto red = table.find("red");
  return red && table.element().properties[*red].type < PlyType::float32;
}

bool add_color_columns(Columns& columns, const PlyTable& table, Tensor& colors) {
  for (const char* name : kColor) {
    if (!table.find(name)) return false;
  }
  for (std::int64_t i = 0; i < 3; ++i) {
    columns.push_back({.property = table.require_property(kColor[i]),
                       .to = colors.data_ptr<float>() + i,
                       .stride = 3});
  }
  return true;
}

/// SH coefficients per channel of a file, beyond the constant one.
std::int64_t count_rest(const PlyTable& table) {
  std::int64_t count = 0;
  while (table.find(indexed_name("f_rest_", count))) ++count;
  for (int degree = 0; degree <= kMaxFileDegree; ++degree) {
    if (count == 3 * gaussians::sh_rest_count(degree)) return count / 3;
  }
  fail_input("{}: {} properties f_rest_*: 0, 9, 24 or 45 expected, for degrees 0 to 3",
             table.name(), count);
}

// f_rest_* is ordered by channel first; the tensor [N,K,3] by coefficient.
void add_rest_columns(Columns& columns, const PlyTable& table, std::int64_t stored, Tensor& rest) {
  const std::int64_t k = rest.size(1);
  for (std::int64_t channel = 0; channel < 3; ++channel) {
    for (std::int64_t i = 0; i < k; ++i) {
      columns.push_back(
          {.property = table.require_property(indexed_name("f_rest_", channel * stored + i)),
           .to = rest.data_ptr<float>() + 3 * i + channel,
           .stride = 3 * k});
    }
  }
}

/// Missing properties that a map of Gaussians has, joined by commas.
std::string missing_properties(const PlyTable& table) {
  std::vector<std::string> needed = {"x",       "y",     "z",     "opacity", "scale_0",
                                     "scale_1", "rot_0", "rot_1", "rot_2",   "rot_3"};
  const bool colored = table.find("red") && table.find("green") && table.find("blue");
  if (!colored || table.find("f_dc_0")) {
    for (const char* name : {"f_dc_0", "f_dc_1", "f_dc_2"}) needed.emplace_back(name);
  }
  std::string missing;
  for (const std::string& name : needed) {
    if (!table.find(name)) missing += (missing.empty() ? "" : ", ") + name;
  }
  return missing;
}

void require_gaussians(const PlyTable& table) {
  const std::string missing = missing_properties(table);
  if (missing.empty()) return;
  const bool none = !table.find("opacity") && !table.find("scale_0") && !table.find("rot_0");
  const PlyElement* const faces = table.header().find("face");
  const char* const what = !none ? ""
                           : faces != nullptr && faces->rows > 0
                               ? "a mesh, not a map of Gaussians: "
                               : "points, not a map of Gaussians: ";
  fail_input("{}:{}: {}the vertices have no property {}", table.name(), table.header().lines, what,
             missing);
}

gaussians::Gaussians read_plain(PlyTable& table) {
  require_gaussians(table);
  const std::int64_t n = table.rows();
  const std::int64_t stored = count_rest(table);
  const std::int64_t rest = std::min(stored, gaussians::sh_rest_count(gaussians::kMaxShDegree));
  if (rest < stored) {
    log::warning("{}: SH coefficients above degree {} were dropped", table.name(),
                 gaussians::kMaxShDegree);
  }
  gaussians::Gaussians g = {.means = torch::empty({n, 3}),
                            .log_scales = torch::full({n, 3}, kFlatLogScale),
                            .quaternions = torch::empty({n, 4}),
                            .logit_opacities = torch::empty({n}),
                            .sh_dc = torch::empty({n, 3}),
                            .sh_rest = torch::empty({n, rest, 3})};
  Columns columns;
  add_position_columns(columns, table, g.means);
  add_columns(columns, table, "scale_", g.log_scales);
  add_columns(columns, table, "rot_", g.quaternions);
  columns.push_back(
      {.property = table.require_property("opacity"), .to = g.logit_opacities.data_ptr<float>()});
  const bool sh = table.find("f_dc_0").has_value();
  if (sh) add_columns(columns, table, "f_dc_", g.sh_dc);
  if (!sh) add_color_columns(columns, table, g.sh_dc);
  add_rest_columns(columns, table, stored, g.sh_rest);
  table.read(columns);
  if (!sh) g.sh_dc = gaussians::color_to_sh_dc(has_byte_colors(table) ? g.sh_dc / 255.0 : g.sh_dc);
  return g;
}

// A zero extent is -inf on the logarithmic scale, an opacity of one is +inf as a logit.
void limit_infinities(gaussians::Gaussians& g) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  g.logit_opacities.masked_fill_(g.logit_opacities == kInfinity, kOpaqueLogit);
  g.logit_opacities.masked_fill_(g.logit_opacities == -kInfinity, -kOpaqueLogit);
  g.log_scales.masked_fill_(g.log_scales == -kInfinity, kFlatLogScale);
}

void drop_invalid(gaussians::Gaussians& g, const std::string& name) {
  Tensor good = g.quaternions.square().sum(1) > 0.0;
  for (const Tensor* tensor : g.tensors()) {
    if (tensor->numel() == 0) continue;
    good = good & torch::isfinite(*tensor).reshape({tensor->size(0), -1}).all(1);
  }
  const auto kept = good.sum().item<std::int64_t>();
  if (kept == g.means.size(0)) return;
  log::warning("{}: {} of {} Gaussians are not finite or have a zero quaternion and were dropped",
               name, g.means.size(0) - kept, g.means.size(0));
  for (Tensor* tensor : g.tensors()) *tensor = tensor->index({good}).contiguous();
}

gaussians::PointCloud centers(const gaussians::Gaussians& g, const Origin& offset) {
  const Tensor shift = torch::tensor({offset[0], offset[1], offset[2]}, torch::kFloat64);
  return {.positions = (g.means.to(torch::kFloat64) - shift).to(torch::kFloat32),
          .colors = gaussians::sh_dc_to_color(g.sh_dc).clamp(0.0, 1.0)};
}

}  // namespace

gaussians::Gaussians read_ply(const fs::path& path) {
  PlyTable table(path);
  const auto open = [&](std::string_view element) { return PlyTable(path, element); };
  gaussians::Gaussians g = is_compressed_ply(table.header())
                               ? to_gaussians(read_compressed_ply(open))
                               : read_plain(table);
  limit_infinities(g);
  drop_invalid(g, path.string());
  return g;
}

gaussians::PointCloud read_ply_points(const fs::path& path, const Origin& origin) {
  PlyTable table(path);
  const std::int64_t n = table.rows();
  const Origin own = origin_of(table.header());
  const Origin offset = {origin[0] - own[0], origin[1] - own[1], origin[2] - own[2]};
  if (is_compressed_ply(table.header())) return centers(read_ply(path), offset);
  gaussians::PointCloud points = {.positions = torch::empty({n, 3}),
                                  .colors = torch::full({n, 3}, 0.5F)};
  Columns columns;
  add_position_columns(columns, table, points.positions, offset);
  const bool map = table.find("f_dc_0").has_value();
  if (map) add_columns(columns, table, "f_dc_", points.colors);
  const bool colored = !map && add_color_columns(columns, table, points.colors);
  table.read(columns);
  if (map) points.colors = gaussians::sh_dc_to_color(points.colors);
  if (colored && has_byte_colors(table)) points.colors = points.colors / 255.0;
  points.colors = points.colors.clamp(0.0, 1.0);
  return points;
}

}  // namespace apvi::map_io
