// SPDX-License-Identifier: BSD-3-Clause
#include "held_out_report.hpp"

#include <torch/torch.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "apvi/bridge/image_files.hpp"
#include "apvi/core/log.hpp"
#include "apvi/mapping/evaluation.hpp"
#include "apvi/splat/metrics.hpp"
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

/// Means over the views that have truth.
class TruthFigures {
 public:
  void add(const mapping::Picture& picture, const SimulatedTruth& truth, const std::string& stamp) {
    const auto cpu = [](const torch::Tensor& t) { return t.to(torch::kCPU, torch::kFloat32); };
    if (const auto depth = truth.depth(stamp)) {
      if (const auto errors = splat::depth_errors(cpu(picture.depth), *depth)) {
        squares_ += errors->rmse_m * errors->rmse_m;
        relative_ += errors->abs_rel;
        ++depths_;
      }
    }
    if (const auto clear = truth.clear(stamp)) {
      restored_ += splat::psnr(cpu(picture.restored).clamp(0.0, 1.0), cpu(*clear) / 255.0);
      ++clears_;
    }
  }

  void put_into(eval::Json& json) const {
    if (depths_ > 0) json["depth_rmse_m"] = std::sqrt(squares_ / depths_);
    if (depths_ > 0) json["depth_abs_rel"] = relative_ / depths_;
    if (clears_ > 0) json["restored_psnr_db"] = restored_ / clears_;
  }

 private:
  double squares_ = 0.0;
  double relative_ = 0.0;
  double restored_ = 0.0;
  int depths_ = 0;
  int clears_ = 0;
};

}  // namespace

eval::Json report_held_out(const mapping::Map& map, const mapping::KeyframeStore& keyframes,
                           const std::filesystem::path& folder, const SimulatedTruth* truth) {
  TruthFigures figures;
  for (const std::size_t i : keyframes.held_out()) {
    mapping::Picture picture = mapping::take_picture(map, keyframes.view(i, 1));
    picture.as_seen = picture.as_seen * mapping::camera_response(map, keyframes, i, 1);
    picture.restored = picture.restored * mapping::camera_gain(map, keyframes, i);
    write_renders(picture, keyframes[i], map.medium.has_value(), folder);
    if (truth != nullptr) figures.add(picture, *truth, keyframes[i].name);
  }
  eval::Json json = eval::Json::object();
  figures.put_into(json);
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
