// SPDX-License-Identifier: BSD-3-Clause
#include "held_out_report.hpp"

#include <torch/torch.h>

#include <nlohmann/json.hpp>
#include <optional>

#include "apvi/bridge/image_files.hpp"
#include "apvi/core/log.hpp"
#include "apvi/mapping/evaluation.hpp"

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

}  // namespace

eval::Json report_held_out(const mapping::Map& map, const mapping::KeyframeStore& keyframes,
                           const std::filesystem::path& folder) {
  for (const std::size_t i : keyframes.held_out()) {
    write_renders(mapping::take_picture(map, keyframes.view(i, 1)), keyframes[i],
                  map.medium.has_value(), folder);
  }
  eval::Json json = eval::Json::object();
  const auto perceptual = splat::Lpips::load(splat::LpipsNet::alex);
  if (perceptual) {
    json["lpips_net"] = splat::net_name(perceptual->net());
  } else {
    log::info("LPIPS: {}", splat::kLpipsAbsent);
  }
  const mapping::ImageMetrics metrics =
      mapping::evaluate_images(map, keyframes, keyframes.held_out(), perceptual);
  put(json, "psnr_db", metrics.psnr_db);
  put(json, "ssim", metrics.ssim);
  put(json, "ms_ssim", metrics.ms_ssim);
  put(json, "lpips", metrics.lpips);
  put(json, "psnr_median_image_db", metrics.psnr_median_image_db);
  json["heldout_views"] = keyframes.held_out().size();
  put(json, "psnr_all_keyframes_db", mapping::mean_psnr(map, keyframes, keyframes.training()));
  return json;
}

}  // namespace apvi::bridge
