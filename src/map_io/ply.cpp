// SPDX-License-Identifier: BSD-3-Clause
#include "map_io/ply.hpp"

#include <torch/torch.h>

#include <array>
#include <cmath>
#include <ostream>
#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/atomic_file.hpp"
#include "core/text.hpp"
#include "gaussians/render/sh_math.hpp"
#include "map_io/ply_table.hpp"

namespace apvi::map_io {
namespace {

namespace fs = std::filesystem;
using torch::Tensor;

constexpr std::int64_t kRowsPerBatch = 4096;

std::string indexed_name(const char* name, std::int64_t i) {
  return name + std::to_string(i);
}

// Columns that fill a contiguous float tensor [N, count] from properties name0, name1, ….
void add_columns(std::vector<PlyColumn>& columns, const PlyTable& table, const char* name,
                 Tensor& tensor) {
  const std::int64_t count = tensor.size(1);
  for (std::int64_t i = 0; i < count; ++i) {
    columns.push_back(
        {table.require_property(indexed_name(name, i)), tensor.data_ptr<float>() + i, count});
  }
}

void add_position_columns(std::vector<PlyColumn>& columns, const PlyTable& table, Tensor& means) {
  const char* const names[] = {"x", "y", "z"};
  for (std::int64_t i = 0; i < 3; ++i) {
    columns.push_back({table.require_property(names[i]), means.data_ptr<float>() + i, 3});
  }
}

// f_rest_* is ordered by channel first; the tensor [N,K,3] by coefficient.
std::int64_t count_rest(const PlyTable& table, const fs::path& path) {
  std::int64_t count = 0;
  while (table.find(indexed_name("f_rest_", count))) ++count;
  for (int degree = 0; degree <= gaussians::kMaxShDegree; ++degree) {
    if (count == 3 * gaussians::sh_rest_count(degree)) return count / 3;
  }
  fail_input("{}: {} properties f_rest_*: 0, 9, 24 or 45 expected, for degrees 0 to 3",
             path.string(), count);
}

void add_rest_columns(std::vector<PlyColumn>& columns, const PlyTable& table, Tensor& rest) {
  const std::int64_t k = rest.size(1);
  for (std::int64_t channel = 0; channel < 3; ++channel) {
    for (std::int64_t i = 0; i < k; ++i) {
      columns.push_back({table.require_property(indexed_name("f_rest_", channel * k + i)),
                         rest.data_ptr<float>() + 3 * i + channel, 3 * k});
    }
  }
}

void drop_invalid(gaussians::Gaussians& g, const fs::path& path) {
  Tensor good = g.quaternions.square().sum(1) > 0.0;
  for (const Tensor* tensor :
       {&g.means, &g.log_scales, &g.quaternions, &g.logit_opacities, &g.sh_dc, &g.sh_rest}) {
    if (tensor->numel() == 0) continue;
    good = good & torch::isfinite(*tensor).reshape({tensor->size(0), -1}).all(1);
  }
  const auto kept = good.sum().item<std::int64_t>();
  if (kept == g.means.size(0)) return;
  log::warning("{}: {} of {} Gaussians are not finite or have a zero quaternion and were dropped",
               path.string(), g.means.size(0) - kept, g.means.size(0));
  for (Tensor* tensor : g.tensors()) *tensor = tensor->index({good}).contiguous();
}

std::string join_numbers(const Tensor& values, std::string_view separator) {
  const Tensor v = values.detach().to(torch::kCPU, torch::kFloat64).contiguous();
  const double* x = v.data_ptr<double>();
  std::string text;
  for (std::int64_t i = 0; i < v.numel(); ++i) {
    text += fmt::format("{}{:.9g}", i == 0 ? "" : separator, x[i]);
  }
  return text;
}

std::string lamp_json(const medium::LampLight& light) {
  const auto three = [](const std::array<double, 3>& v) {
    return fmt::format("{:.9g}, {:.9g}, {:.9g}", v[0], v[1], v[2]);
  };
  return fmt::format(
      ",\n  \"lamp\": {{\n    \"position_m\": [{}],\n    \"axis\": [{}],\n    \"half_beam_deg\": "
      "{:.9g},\n"
      "    \"unit_range_m\": {:.9g},\n    \"daylight\": [{}],\n    \"backscatter\": [{}]\n  }}",
      three(light.lamp.position_m), three(light.lamp.axis),
      light.lamp.half_beam_rad * 180.0 / std::acos(-1.0), light.unit_range_m,
      join_numbers(light.daylight, ", "), join_numbers(light.backscatter, ", "));
}

std::string header_text(std::int64_t count, std::int64_t rest,
                        const std::optional<medium::Medium>& medium) {
  std::string text = "ply\nformat binary_little_endian 1.0\n";
  if (medium) {
    text += fmt::format("comment beta_d {}\ncomment beta_b {}\ncomment b_inf {}\n",
                        join_numbers(medium->beta_d, " "), join_numbers(medium->beta_b, " "),
                        join_numbers(medium->b_inf, " "));
    if (medium->lamp)
      text += fmt::format("comment lamp {}\n",
                          join_numbers(medium::lamp_to_tensor(*medium->lamp), " "));
  }
  text += fmt::format("element vertex {}\n", count);
  const auto property = [&text](const std::string& name) {
    text += "property float " + name + "\n";
  };
  for (const char* name : {"x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"}) {
    property(name);
  }
  for (std::int64_t i = 0; i < 3 * rest; ++i) property(indexed_name("f_rest_", i));
  for (const char* name :
       {"opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"}) {
    property(name);
  }
  return text + "end_header\n";
}

// Rows [begin, end) in file order.
Tensor file_rows(const gaussians::Gaussians& g, std::int64_t begin, std::int64_t end) {
  const auto rows = [&](const Tensor& tensor) {
    return tensor.detach().slice(0, begin, end).to(torch::kCPU, torch::kFloat32);
  };
  const std::int64_t n = end - begin;
  return torch::cat({rows(g.means), torch::zeros({n, 3}), rows(g.sh_dc),
                     rows(g.sh_rest).transpose(1, 2).reshape({n, -1}),
                     rows(g.logit_opacities).unsqueeze(1), rows(g.log_scales), rows(g.quaternions)},
                    1)
      .contiguous();
}

void check_shapes(const gaussians::Gaussians& g) {
  const std::int64_t n = g.size();
  TORCH_CHECK(g.sh_rest.dim() == 3 && g.sh_rest.size(0) == n && g.sh_rest.size(2) == 3,
              "map: sh_rest has shape ", g.sh_rest.sizes());
  TORCH_CHECK(g.logit_opacities.sizes() == at::IntArrayRef({n}), "map: opacities have shape ",
              g.logit_opacities.sizes());
}

/// `count` numbers after a keyword in a header comment, float64.
std::optional<Tensor> comment_numbers(const PlyHeader& header, std::string_view name,
                                      std::size_t count) {
  for (const std::string& comment : header.comments) {
    std::vector<std::string_view> words;
    text::split(comment, ' ', words);
    if (words.size() != count + 1 || words[0] != name) continue;
    std::vector<double> numbers;
    for (std::size_t i = 1; i < words.size(); ++i) {
      if (const auto number = text::parse_double(words[i])) numbers.push_back(*number);
    }
    if (numbers.size() == count) return torch::tensor(numbers, torch::kFloat64);
  }
  return std::nullopt;
}

}  // namespace

gaussians::Gaussians read_ply(const fs::path& path) {
  PlyTable table(path);
  const std::int64_t n = table.header().vertices;
  const std::int64_t rest = count_rest(table, path);
  for (const char* name : {"x", "f_dc_0", "opacity", "scale_0", "rot_0"})
    table.require_property(name);
  gaussians::Gaussians g = {.means = torch::empty({n, 3}),
                            .log_scales = torch::empty({n, 3}),
                            .quaternions = torch::empty({n, 4}),
                            .logit_opacities = torch::empty({n}),
                            .sh_dc = torch::empty({n, 3}),
                            .sh_rest = torch::empty({n, rest, 3})};
  std::vector<PlyColumn> columns;
  add_position_columns(columns, table, g.means);
  add_columns(columns, table, "scale_", g.log_scales);
  add_columns(columns, table, "rot_", g.quaternions);
  columns.push_back({table.require_property("opacity"), g.logit_opacities.data_ptr<float>(), 1});
  add_columns(columns, table, "f_dc_", g.sh_dc);
  add_rest_columns(columns, table, g.sh_rest);
  table.read(columns);
  drop_invalid(g, path);
  return g;
}

void write_ply(const fs::path& path, const gaussians::Gaussians& gaussians,
               const std::optional<medium::Medium>& medium) {
  check_shapes(gaussians);
  const std::int64_t n = gaussians.size();
  write_file_atomically(path, [&](std::ostream& out) {
    out << header_text(n, gaussians.sh_rest.size(1), medium);
    for (std::int64_t begin = 0; begin < n && out; begin += kRowsPerBatch) {
      const Tensor rows = file_rows(gaussians, begin, std::min(n, begin + kRowsPerBatch));
      out.write(reinterpret_cast<const char*>(rows.data_ptr<float>()),
                static_cast<std::streamsize>(rows.nbytes()));
    }
  });
}

std::optional<medium::Medium> read_ply_medium(const fs::path& path) {
  const PlyTable table(path);
  const auto beta_d = comment_numbers(table.header(), "beta_d", 3);
  const auto beta_b = comment_numbers(table.header(), "beta_b", 3);
  const auto b_inf = comment_numbers(table.header(), "b_inf", 3);
  if (!beta_d || !beta_b || !b_inf) return std::nullopt;
  medium::Medium medium = {.beta_d = beta_d->to(torch::kFloat32),
                           .beta_b = beta_b->to(torch::kFloat32),
                           .b_inf = b_inf->to(torch::kFloat32)};
  if (const auto lamp = comment_numbers(table.header(), "lamp", medium::kLampParameterCount)) {
    medium.lamp = medium::lamp_from_tensor(*lamp);
  }
  return medium;
}

void write_medium_json(const fs::path& path, const medium::Medium& medium) {
  write_file_atomically(path, [&](std::ostream& out) {
    out << fmt::format("{{\n  \"beta_d\": [{}],\n  \"beta_b\": [{}],\n  \"b_inf\": [{}]{}\n}}\n",
                       join_numbers(medium.beta_d, ", "), join_numbers(medium.beta_b, ", "),
                       join_numbers(medium.b_inf, ", "),
                       medium.lamp ? lamp_json(*medium.lamp) : "");
  });
}

gaussians::PointCloud read_ply_points(const fs::path& path) {
  PlyTable table(path);
  const std::int64_t n = table.header().vertices;
  gaussians::PointCloud points = {.positions = torch::empty({n, 3}),
                                  .colors = torch::full({n, 3}, 0.5F)};
  std::vector<PlyColumn> columns;
  add_position_columns(columns, table, points.positions);
  const bool map = table.find("f_dc_0").has_value();
  const char* const names[] = {"red", "green", "blue"};
  const bool colored = !map && table.find("red") && table.find("green") && table.find("blue");
  if (map) add_columns(columns, table, "f_dc_", points.colors);
  for (std::int64_t i = 0; colored && i < 3; ++i) {
    columns.push_back({table.require_property(names[i]), points.colors.data_ptr<float>() + i, 3});
  }
  table.read(columns);
  if (map) points.colors = gaussians::sh_dc_to_color(points.colors);
  const bool bytes =
      colored && table.header().properties[table.require_property("red")].type < PlyType::float32;
  if (bytes) points.colors = points.colors / 255.0;
  points.colors = points.colors.clamp(0.0, 1.0);
  return points;
}

}  // namespace apvi::map_io
