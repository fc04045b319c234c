// SPDX-License-Identifier: BSD-3-Clause
#include "held_out_report.hpp"

#include <fmt/format.h>
#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "apvi/bridge/image_files.hpp"
#include "apvi/core/atomic_file.hpp"
#include "apvi/core/log.hpp"
#include "apvi/mapping/evaluation.hpp"
#include "apvi/mapping/surface_depth.hpp"
#include "apvi/splat/metrics.hpp"
#include "apvi/splat/render.hpp"
#include "simulated_truth.hpp"

namespace apvi::bridge {
namespace {

void write_renders(const mapping::Picture& picture, const mapping::Keyframe& keyframe, bool water,
                   const std::filesystem::path& folder) {
  const auto file = [&](const char* kind) {
    return folder / (keyframe.name + "_" + kind + ".png");
  };
  write_png(file("truth"), keyframe.image);
  write_png(file("render"), picture.as_seen);
  if (water) write_png(file("restored"), picture.restored);
  write_depth_png(file("depth"), picture.depth);
}

void put(eval::Json& json, const char* key, const std::optional<double>& value) {
  if (value) json[key] = *value;
}

// Of the light of a surface, in the colour that the water absorbs least: what less of comes through
// cannot be told from the water.
constexpr double kSeen = 0.05;

/// Where a picture tells of what is there, [H,W] bool: surfaces near enough, and open water.
torch::Tensor can_be_seen(const torch::Tensor& depth, const splat::Medium& water,
                          const splat::Intrinsics& camera) {
  const double clearest = water.beta_d.min().item<double>();
  return splat::depth_to_range(depth, camera) < -std::log(kSeen) / clearest;
}

double masked_psnr(const torch::Tensor& image, const torch::Tensor& truth,
                   const torch::Tensor& mask) {
  const torch::Tensor squares = (image - truth).square().mean(2);
  const double error = squares.index({mask}).mean().item<double>();
  return -10.0 * std::log10(std::max(1e-12, error));
}

/// How far one view, or all of them, are from what a simulator knows; what it does not is absent.
struct TruthErrors {
  std::optional<double> depth_mean_m;  ///< of the truth
  std::optional<double> depth_rmse_m;
  std::optional<double> depth_abs_rel;
  std::optional<double> depth_seen_rmse_m;        ///< where the picture tells of what is there
  std::optional<double> depth_half_pixel_rmse_m;  ///< of the truth, half a pixel aside
  std::optional<double> restored_psnr_db;
  std::optional<double> restored_seen_psnr_db;
};

using Figure = std::optional<double> TruthErrors::*;
struct NamedFigure {
  const char* name = nullptr;
  Figure value = nullptr;
  bool squares_add_up = false;
};
constexpr std::array<NamedFigure, 7> kFigures = {
    {{"depth_mean_m", &TruthErrors::depth_mean_m},
     {"depth_rmse_m", &TruthErrors::depth_rmse_m, true},
     {"depth_abs_rel", &TruthErrors::depth_abs_rel},
     {"depth_seen_rmse_m", &TruthErrors::depth_seen_rmse_m, true},
     {"depth_half_pixel_rmse_m", &TruthErrors::depth_half_pixel_rmse_m, true},
     {"restored_psnr_db", &TruthErrors::restored_psnr_db},
     {"restored_seen_psnr_db", &TruthErrors::restored_seen_psnr_db}}};

struct ImageFigure {
  const char* name = nullptr;
  std::optional<double> mapping::ImageMetrics::*value = nullptr;
};
constexpr std::array<ImageFigure, 5> kImageFigures = {
    {{"psnr_db", &mapping::ImageMetrics::psnr_db},
     {"ssim", &mapping::ImageMetrics::ssim},
     {"ms_ssim", &mapping::ImageMetrics::ms_ssim},
     {"lpips", &mapping::ImageMetrics::lpips},
     {"psnr_median_image_db", &mapping::ImageMetrics::psnr_median_image_db}}};

TruthErrors compare(const mapping::Picture& picture, const mapping::Keyframe& keyframe,
                    const SimulatedTruth& truth, const std::optional<splat::Medium>& water) {
  const auto cpu = [](const torch::Tensor& t) { return t.to(torch::kCPU, torch::kFloat32); };
  TruthErrors out;
  const auto depth = truth.depth(keyframe.name);
  torch::Tensor seen;
  if (depth && water) seen = can_be_seen(*depth, *water, keyframe.intrinsics);
  if (depth) {
    if (const auto errors = splat::depth_errors(cpu(picture.depth), *depth)) {
      out.depth_rmse_m = errors->rmse_m;
      out.depth_abs_rel = errors->abs_rel;
      out.depth_mean_m = depth->index({*depth > 0}).mean().item<double>();
    }
    out.depth_half_pixel_rmse_m = splat::half_pixel_depth_rmse(*depth);
    if (seen.defined()) {
      const auto errors = splat::depth_errors(cpu(picture.depth), *depth * seen);
      if (errors) out.depth_seen_rmse_m = errors->rmse_m;
    }
  }
  if (const auto clear = truth.clear(keyframe.name)) {
    const torch::Tensor restored = cpu(picture.restored).clamp(0.0, 1.0);
    const torch::Tensor wanted = cpu(*clear) / 255.0;
    out.restored_psnr_db = splat::psnr(restored, wanted);
    if (seen.defined() && seen.any().item<bool>()) {
      out.restored_seen_psnr_db = masked_psnr(restored, wanted, seen);
    }
  }
  return out;
}

/// Mean, or root of the mean square, of those that have it.
std::optional<double> mean_of(const std::vector<TruthErrors>& views, const NamedFigure& figure) {
  double sum = 0.0;
  int count = 0;
  for (const TruthErrors& view : views) {
    const auto& value = view.*figure.value;
    if (!value) continue;
    sum += figure.squares_add_up ? *value * *value : *value;
    ++count;
  }
  if (count == 0) return std::nullopt;
  return figure.squares_add_up ? std::sqrt(sum / count) : sum / count;
}

std::string cell(const std::optional<double>& value) {
  return value ? fmt::format(",{:.5g}", *value) : ",";
}

/// One line a view: where a map is weak, a mean does not say.
void write_views(const std::filesystem::path& file, const mapping::KeyframeStore& keyframes,
                 const std::vector<mapping::ImageMetrics>& images,
                 const std::vector<TruthErrors>& errors) {
  std::string text = "#image";
  for (const ImageFigure& figure : kImageFigures) text += fmt::format(",{}", figure.name);
  for (const NamedFigure& figure : kFigures) text += fmt::format(",{}", figure.name);
  text += '\n';
  for (std::size_t k = 0; k < images.size(); ++k) {
    text += keyframes[keyframes.held_out()[k]].name;
    for (const ImageFigure& figure : kImageFigures) text += cell(images[k].*figure.value);
    const TruthErrors none;
    const TruthErrors& view = k < errors.size() ? errors[k] : none;
    for (const NamedFigure& figure : kFigures) text += cell(view.*figure.value);
    text += '\n';
  }
  write_file_atomically(file, [&](std::ostream& out) { out << text; });
}

}  // namespace

eval::Json report_held_out(const mapping::Map& map, const mapping::KeyframeStore& keyframes,
                           const std::filesystem::path& folder, const SimulatedTruth* truth) {
  const auto water = truth != nullptr ? truth->medium() : std::nullopt;
  std::vector<TruthErrors> errors;
  for (const std::size_t i : keyframes.held_out()) {
    const splat::View view = keyframes.view(i, 1);
    mapping::Picture picture = mapping::take_picture(map, view);
    picture.depth = mapping::surface_depth(map, view, picture.depth, picture.alpha);
    picture.as_seen = picture.as_seen * mapping::camera_response(map, keyframes, i, 1);
    picture.restored = picture.restored * mapping::camera_gain(map, keyframes, i);
    write_renders(picture, keyframes[i], map.medium.has_value(), folder);
    if (truth != nullptr) errors.push_back(compare(picture, keyframes[i], *truth, water));
  }
  eval::Json json = eval::Json::object();
  for (const NamedFigure& figure : kFigures) put(json, figure.name, mean_of(errors, figure));
  const auto perceptual = splat::Lpips::load(splat::LpipsNet::alex);
  if (perceptual) {
    json["lpips_net"] = splat::net_name(perceptual->net());
  } else {
    log::info("LPIPS: {}", splat::kLpipsAbsent);
  }
  const std::vector<mapping::ImageMetrics> images =
      mapping::evaluate_images(map, keyframes, keyframes.held_out(), perceptual);
  write_views(folder / "views.csv", keyframes, images, errors);
  const mapping::ImageMetrics metrics = mapping::mean_of(images);
  for (const ImageFigure& figure : kImageFigures) put(json, figure.name, metrics.*figure.value);
  json["heldout_views"] = keyframes.held_out().size();
  put(json, "psnr_all_keyframes_db", mapping::mean_psnr(map, keyframes, keyframes.training()));
  return json;
}

}  // namespace apvi::bridge
