// SPDX-License-Identifier: BSD-3-Clause
#include "runs/quality/held_out_report.hpp"

#include <fmt/format.h>
#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "apvi/core/log.hpp"
#include "core/atomic_file.hpp"
#include "gaussians/metrics/metrics.hpp"
#include "mapping/appearance/display_exposure.hpp"
#include "mapping/evaluation.hpp"
#include "mapping/medium/range_bias.hpp"
#include "mapping/surface_depth.hpp"
#include "runs/quality/off_path_report.hpp"
#include "runs/quality/simulated_truth.hpp"
#include "runs/quality/truth_errors.hpp"
#include "runs/views/image_files.hpp"

namespace apvi::runs {
namespace {

void write_renders(const mapping::MapRendering& rendering, const mapping::Keyframe& keyframe,
                   bool water, const std::filesystem::path& folder) {
  const auto file = [&](const char* kind) {
    return folder / (keyframe.name + "_" + kind + ".png");
  };
  write_png(file("truth"), keyframe.image);
  write_png(file("render"), rendering.color);
  if (water) write_png(file("restored"), rendering.restored);
  write_depth_png(file("depth"), rendering.depth);
}

/// For all restored images of a run. Without ground truth: that is compared in its own exposure.
std::optional<mapping::DisplayExposure> exposure_of(const mapping::Map& map,
                                                    const mapping::KeyframeStore& keyframes,
                                                    const SimulatedTruth* truth) {
  if (!map.medium || truth != nullptr) return std::nullopt;
  std::vector<gaussians::View> views;
  for (const std::size_t i : keyframes.training()) views.push_back(keyframes.view(i, 1));
  return mapping::display_exposure(map, views);
}

/// A rendering of keyframe i as image values, with the camera's response. The restored image has
/// the exposure for viewing, or that of the truth, or else that of the camera.
mapping::MapRendering as_image_values(mapping::MapRendering rendering, const mapping::Map& map,
                                      const mapping::KeyframeStore& keyframes, std::size_t i,
                                      const std::optional<mapping::DisplayExposure>& exposure,
                                      const std::optional<mapping::DisplayExposure>& of_truth) {
  const gaussians::ToneCurve& curve = map.tone_curve;
  rendering.color = curve.encode(rendering.color * mapping::camera_response(map, keyframes, i, 1));
  if (of_truth) {
    rendering.restored = curve.encode(mapping::exposed(rendering.restored, *of_truth));
  } else if (exposure) {
    rendering.restored = mapping::displayed(rendering.restored, *exposure, curve);
  } else {
    rendering.restored = curve.encode(rendering.restored * mapping::camera_gain(map, keyframes, i));
  }
  return rendering;
}

eval::Json to_json(const mapping::RangeBias& bias) {
  return {{"image_per_m", bias.image},
          {"restored_per_m", bias.restored},
          {"range_spread_m", bias.range_spread_m},
          {"points", bias.points},
          {"observations", bias.observations}};
}

void set_if_present(eval::Json& json, const char* key, const std::optional<double>& value) {
  if (value) json[key] = *value;
}

struct NamedImageMetric {
  const char* name = nullptr;
  std::optional<double> mapping::ImageMetrics::*value = nullptr;
};
constexpr std::array<NamedImageMetric, 5> kImageColumns = {
    {{"psnr_db", &mapping::ImageMetrics::psnr_db},
     {"ssim", &mapping::ImageMetrics::ssim},
     {"ms_ssim", &mapping::ImageMetrics::ms_ssim},
     {"lpips", &mapping::ImageMetrics::lpips},
     {"psnr_median_image_db", &mapping::ImageMetrics::psnr_median_image_db}}};

std::string cell(const std::optional<double>& value) {
  return value ? fmt::format(",{:.5g}", *value) : ",";
}

/// Writes one line per view.
void write_views(const std::filesystem::path& file, const mapping::KeyframeStore& keyframes,
                 const std::vector<mapping::ImageMetrics>& images,
                 const std::vector<TruthErrors>& errors) {
  std::string text = "#image";
  for (const NamedImageMetric& column : kImageColumns) text += fmt::format(",{}", column.name);
  for (const NamedError& column : kErrorColumns) text += fmt::format(",{}", column.name);
  text += '\n';
  for (std::size_t k = 0; k < images.size(); ++k) {
    text += keyframes[keyframes.held_out()[k]].name;
    for (const NamedImageMetric& column : kImageColumns) text += cell(images[k].*column.value);
    const TruthErrors none;
    const TruthErrors& view = k < errors.size() ? errors[k] : none;
    for (const NamedError& column : kErrorColumns) text += cell(view.*column.value);
    text += '\n';
  }
  write_file_atomically(file, [&](std::ostream& out) { out << text; });
}

}  // namespace

eval::Json report_held_out(const mapping::Map& map, const mapping::KeyframeStore& keyframes,
                           const std::filesystem::path& folder, const SimulatedTruth* truth) {
  const auto water = truth != nullptr ? truth->medium() : std::nullopt;
  const auto exposure = exposure_of(map, keyframes, truth);
  const auto of_truth = truth != nullptr ? exposure_of_truth(map, keyframes, *truth) : std::nullopt;
  std::vector<TruthErrors> errors;
  for (const std::size_t i : keyframes.held_out()) {
    const gaussians::View view = keyframes.view(i, 1);
    mapping::MapRendering rendering = mapping::render_map(map, view);
    rendering.depth = mapping::surface_depth(map, view, rendering.depth, rendering.alpha);
    rendering = as_image_values(rendering, map, keyframes, i, exposure, of_truth);
    write_renders(rendering, keyframes[i], map.medium.has_value(), folder);
    if (truth == nullptr) continue;
    errors.push_back(compare(rendering, keyframes[i], *truth, water));
    if (const auto moving = truth->moving(keyframes[i].name)) {
      write_png(folder / (keyframes[i].name + "_moving.png"),
                moving->unsqueeze(2).expand({-1, -1, 3}));
    }
  }
  eval::Json json = eval::Json::object();
  for (const NamedError& column : kErrorColumns)
    set_if_present(json, column.name, mean_of(errors, column));
  json["tone_curve"] = {{"gamma", map.tone_curve.gamma}, {"offset", map.tone_curve.offset}};
  if (exposure) json["restored_gain"] = exposure->gains();
  if (of_truth) json["restored_factors"] = of_truth->gains();
  if (const auto bias = mapping::range_bias(map, keyframes, keyframes.held_out()))
    json["range_bias"] = to_json(*bias);
  if (truth != nullptr) add_off_path_views(map, keyframes, *truth, folder, json);
  const auto perceptual = gaussians::Lpips::load(gaussians::LpipsNet::alex);
  if (perceptual) {
    json["lpips_net"] = gaussians::net_name(perceptual->net());
  } else {
    log::info("LPIPS: {}", gaussians::kLpipsUnavailable);
  }
  const std::vector<mapping::ImageMetrics> images =
      mapping::evaluate_images(map, keyframes, keyframes.held_out(), perceptual);
  write_views(folder / "views.csv", keyframes, images, errors);
  const mapping::ImageMetrics metrics = mapping::mean_of(images);
  for (const NamedImageMetric& column : kImageColumns)
    set_if_present(json, column.name, metrics.*column.value);
  json["heldout_views"] = keyframes.held_out().size();
  set_if_present(json, "psnr_all_keyframes_db",
                 mapping::mean_psnr(map, keyframes, keyframes.training()));
  return json;
}

}  // namespace apvi::runs
