// SPDX-License-Identifier: BSD-3-Clause
#include "map_io/map_comments.hpp"

#include <fmt/format.h>
#include <torch/torch.h>

#include <array>
#include <cmath>
#include <ostream>
#include <string_view>
#include <vector>

#include "core/atomic_file.hpp"
#include "core/text.hpp"
#include "map_io/ply.hpp"
#include "map_io/ply_table.hpp"

namespace apvi::map_io {
namespace {

namespace fs = std::filesystem;
using torch::Tensor;

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

/// `count` numbers after a keyword in a header comment, float64.
std::optional<std::vector<double>> comment_numbers(const PlyHeader& header, std::string_view name,
                                                   std::size_t count) {
  for (const std::string& comment : header.comments) {
    std::vector<std::string_view> words;
    text::split(comment, ' ', words);
    if (words.size() != count + 1 || words[0] != name) continue;
    std::vector<double> numbers;
    for (std::size_t i = 1; i < words.size(); ++i) {
      if (const auto number = text::parse_double(words[i])) numbers.push_back(*number);
    }
    if (numbers.size() == count) return numbers;
  }
  return std::nullopt;
}

std::optional<Tensor> comment_tensor(const PlyHeader& header, std::string_view name,
                                     std::size_t count) {
  const auto numbers = comment_numbers(header, name, count);
  return numbers ? std::optional(torch::tensor(*numbers, torch::kFloat64)) : std::nullopt;
}

}  // namespace

bool is_zero(const Origin& origin) {
  return origin == Origin{};
}

std::string comment_lines(const std::optional<medium::Medium>& medium, const Origin& origin,
                          const gaussians::ToneCurve& curve) {
  std::string text;
  if (!is_zero(origin)) {
    text +=
        fmt::format("comment origin {:.17g} {:.17g} {:.17g}\n", origin[0], origin[1], origin[2]);
  }
  if (!curve.is_linear()) {
    text += fmt::format("comment tone_curve {:.9g} {:.9g}\n", curve.gamma, curve.offset);
  }
  if (!medium) return text;
  text += fmt::format("comment beta_d {}\ncomment beta_b {}\ncomment b_inf {}\n",
                      join_numbers(medium->beta_d, " "), join_numbers(medium->beta_b, " "),
                      join_numbers(medium->b_inf, " "));
  if (medium->lamp) {
    text +=
        fmt::format("comment lamp {}\n", join_numbers(medium::lamp_to_tensor(*medium->lamp), " "));
  }
  return text;
}

std::optional<medium::Medium> medium_of(const PlyHeader& header) {
  const auto beta_d = comment_tensor(header, "beta_d", 3);
  const auto beta_b = comment_tensor(header, "beta_b", 3);
  const auto b_inf = comment_tensor(header, "b_inf", 3);
  if (!beta_d || !beta_b || !b_inf) return std::nullopt;
  medium::Medium medium = {.beta_d = beta_d->to(torch::kFloat32),
                           .beta_b = beta_b->to(torch::kFloat32),
                           .b_inf = b_inf->to(torch::kFloat32)};
  if (const auto lamp = comment_tensor(header, "lamp", medium::kLampParameterCount)) {
    medium.lamp = medium::lamp_from_tensor(*lamp);
  }
  return medium;
}

std::optional<medium::Medium> read_ply_medium(const fs::path& path) {
  return medium_of(PlyTable(path).header());
}

Origin origin_of(const PlyHeader& header) {
  const auto numbers = comment_numbers(header, "origin", 3);
  if (!numbers) return {};
  Origin origin = {(*numbers)[0], (*numbers)[1], (*numbers)[2]};
  for (const double x : origin) {
    if (!std::isfinite(x)) return {};
  }
  return origin;
}

gaussians::ToneCurve tone_curve_of(const PlyHeader& header) {
  const auto numbers = comment_numbers(header, "tone_curve", 2);
  if (!numbers) return {};
  const gaussians::ToneCurve curve{.gamma = (*numbers)[0], .offset = (*numbers)[1]};
  const bool valid =
      curve.gamma > 0.1 && curve.gamma < 10.0 && curve.offset >= 0.0 && curve.offset < 1.0;
  return valid ? curve : gaussians::ToneCurve{};
}

void write_medium_json(const fs::path& path, const medium::Medium& medium) {
  write_file_atomically(path, [&](std::ostream& out) {
    out << fmt::format("{{\n  \"beta_d\": [{}],\n  \"beta_b\": [{}],\n  \"b_inf\": [{}]{}\n}}\n",
                       join_numbers(medium.beta_d, ", "), join_numbers(medium.beta_b, ", "),
                       join_numbers(medium.b_inf, ", "),
                       medium.lamp ? lamp_json(*medium.lamp) : "");
  });
}

}  // namespace apvi::map_io
