// SPDX-License-Identifier: BSD-3-Clause
#include "map_io/map_comments.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <torch/torch.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
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
  std::vector<std::string> lamps;
  for (const medium::Lamp& lamp : light.lamps) {
    lamps.push_back(fmt::format(
        "{{\"position_m\": [{}], \"axis\": [{}], \"half_beam_deg\": {:.9g}, \"edge\": {:.9g}, "
        "\"share\": {:.9g}}}",
        three(lamp.position_m), three(lamp.axis), lamp.half_beam_rad * 180.0 / std::acos(-1.0),
        lamp.edge, lamp.share));
  }
  return fmt::format(
      ",\n  \"lamp\": {{\n    \"lamps\": [\n      {}\n    ],\n"
      "    \"unit_range_m\": {:.9g},\n    \"daylight\": [{}],\n    \"backscatter\": [{}]\n  }}",
      fmt::join(lamps, ",\n      "), light.unit_range_m, join_numbers(light.daylight, ", "),
      join_numbers(light.backscatter, ", "));
}

/// The numbers after a keyword in a header comment, float64; their count is valid.
std::optional<std::vector<double>> comment_numbers(
    const PlyHeader& header, std::string_view name,
    const std::function<bool(std::size_t)>& is_valid_count) {
  for (const std::string& comment : header.comments) {
    std::vector<std::string_view> words;
    text::split(comment, ' ', words);
    if (words.empty() || words[0] != name || !is_valid_count(words.size() - 1)) continue;
    std::vector<double> numbers;
    for (std::size_t i = 1; i < words.size(); ++i) {
      if (const auto number = text::parse_double(words[i])) numbers.push_back(*number);
    }
    if (numbers.size() == words.size() - 1) return numbers;
  }
  return std::nullopt;
}

std::optional<std::vector<double>> comment_numbers(const PlyHeader& header, std::string_view name,
                                                   std::size_t count) {
  return comment_numbers(header, name, [count](std::size_t n) { return n == count; });
}

std::optional<Tensor> rgb_comment(const PlyHeader& header, std::string_view name) {
  const auto numbers = comment_numbers(header, name, 3);
  return numbers ? std::optional(torch::tensor(*numbers, torch::kFloat64)) : std::nullopt;
}

}  // namespace

bool is_zero(const Origin& origin) {
  return origin == Origin{};
}

std::string comment_lines(const std::optional<medium::Medium>& medium, const Origin& origin,
                          const CameraResponse& camera) {
  std::string text;
  if (!is_zero(origin)) {
    text +=
        fmt::format("comment origin {:.17g} {:.17g} {:.17g}\n", origin[0], origin[1], origin[2]);
  }
  if (const gaussians::ToneCurve& curve = camera.tone_curve; !curve.is_linear()) {
    text += fmt::format("comment tone_curve {:.9g} {:.9g}\n", curve.gamma, curve.offset);
  }
  if (const medium::Vignetting& lens = camera.vignetting; !lens.is_none()) {
    text += fmt::format("comment vignetting {:.9g} {:.9g}\n", lens.square, lens.fourth);
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
  const auto beta_d = rgb_comment(header, "beta_d");
  const auto beta_b = rgb_comment(header, "beta_b");
  const auto b_inf = rgb_comment(header, "b_inf");
  if (!beta_d || !beta_b || !b_inf) return std::nullopt;
  medium::Medium medium = {.beta_d = beta_d->to(torch::kFloat32),
                           .beta_b = beta_b->to(torch::kFloat32),
                           .b_inf = b_inf->to(torch::kFloat32)};
  const auto is_lamp = [](std::size_t n) {
    return medium::is_lamp_tensor_size(static_cast<std::int64_t>(n));
  };
  if (const auto numbers = comment_numbers(header, "lamp", is_lamp)) {
    medium.lamp = medium::lamp_from_tensor(torch::tensor(*numbers, torch::kFloat64));
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

namespace {

gaussians::ToneCurve tone_curve_of(const PlyHeader& header) {
  const auto numbers = comment_numbers(header, "tone_curve", 2);
  if (!numbers) return {};
  const gaussians::ToneCurve curve{.gamma = (*numbers)[0], .offset = (*numbers)[1]};
  const bool valid =
      curve.gamma > 0.1 && curve.gamma < 10.0 && curve.offset >= 0.0 && curve.offset < 1.0;
  return valid ? curve : gaussians::ToneCurve{};
}

}  // namespace

CameraResponse camera_response_of(const PlyHeader& header) {
  CameraResponse camera{.tone_curve = tone_curve_of(header), .vignetting = {}};
  const auto numbers = comment_numbers(header, "vignetting", 2);
  if (numbers && std::isfinite((*numbers)[0]) && std::isfinite((*numbers)[1])) {
    camera.vignetting = {.square = (*numbers)[0], .fourth = (*numbers)[1]};
  }
  return camera;
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
