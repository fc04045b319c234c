// SPDX-License-Identifier: BSD-3-Clause
#include "held_out_report.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "apvi/bridge/image_files.hpp"
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

/// A mean of figures that some views have.
struct Mean {
  double sum = 0.0;
  int count = 0;
  void add(double value) {
    sum += value;
    ++count;
  }
  std::optional<double> value() const {
    return count > 0 ? std::optional(sum / count) : std::nullopt;
  }
};

std::optional<double> root(const Mean& squares) {
  const auto mean = squares.value();
  return mean ? std::optional(std::sqrt(*mean)) : std::nullopt;
}

/// Means over the views that have truth.
class TruthFigures {
 public:
  explicit TruthFigures(const SimulatedTruth& truth) : truth_(truth), water_(truth.medium()) {}

  void add(const mapping::Picture& picture, const mapping::Keyframe& keyframe) {
    const auto cpu = [](const torch::Tensor& t) { return t.to(torch::kCPU, torch::kFloat32); };
    const auto depth = truth_.depth(keyframe.name);
    torch::Tensor seen;
    if (depth && water_) seen = can_be_seen(*depth, *water_, keyframe.intrinsics);
    if (depth) add_depth(cpu(picture.depth), *depth, seen);
    if (const auto clear = truth_.clear(keyframe.name)) {
      const torch::Tensor restored = cpu(picture.restored).clamp(0.0, 1.0);
      const torch::Tensor wanted = cpu(*clear) / 255.0;
      restored_.add(splat::psnr(restored, wanted));
      if (seen.defined() && seen.any().item<bool>()) {
        restored_seen_.add(masked_psnr(restored, wanted, seen));
      }
    }
  }

  void put_into(eval::Json& json) const {
    put(json, "depth_mean_m", mean_.value());
    put(json, "depth_rmse_m", root(squares_));
    put(json, "depth_abs_rel", relative_.value());
    put(json, "depth_seen_rmse_m", root(seen_squares_));
    put(json, "restored_psnr_db", restored_.value());
    put(json, "restored_seen_psnr_db", restored_seen_.value());
  }

 private:
  void add_depth(const torch::Tensor& depth, const torch::Tensor& truth,
                 const torch::Tensor& seen) {
    if (const auto errors = splat::depth_errors(depth, truth)) {
      squares_.add(errors->rmse_m * errors->rmse_m);
      relative_.add(errors->abs_rel);
      mean_.add(truth.index({truth > 0}).mean().item<double>());
    }
    if (!seen.defined()) return;
    if (const auto errors = splat::depth_errors(depth, truth * seen)) {
      seen_squares_.add(errors->rmse_m * errors->rmse_m);
    }
  }

  const SimulatedTruth& truth_;
  std::optional<splat::Medium> water_;
  Mean mean_, squares_, relative_, seen_squares_, restored_, restored_seen_;
};

}  // namespace

eval::Json report_held_out(const mapping::Map& map, const mapping::KeyframeStore& keyframes,
                           const std::filesystem::path& folder, const SimulatedTruth* truth) {
  std::optional<TruthFigures> figures;
  if (truth != nullptr) figures.emplace(*truth);
  for (const std::size_t i : keyframes.held_out()) {
    const splat::View view = keyframes.view(i, 1);
    mapping::Picture picture = mapping::take_picture(map, view);
    picture.depth = mapping::surface_depth(map, view, picture.depth, picture.alpha);
    picture.as_seen = picture.as_seen * mapping::camera_response(map, keyframes, i, 1);
    picture.restored = picture.restored * mapping::camera_gain(map, keyframes, i);
    write_renders(picture, keyframes[i], map.medium.has_value(), folder);
    if (figures) figures->add(picture, keyframes[i]);
  }
  eval::Json json = eval::Json::object();
  if (figures) figures->put_into(json);
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
