// SPDX-License-Identifier: BSD-3-Clause
#include "runs/moving_report.hpp"

#include <torch/torch.h>

#include <cstdint>
#include <nlohmann/json.hpp>

#include "runs/image_files.hpp"
#include "runs/simulated_truth.hpp"

namespace apvi::runs {
namespace {

using torch::Tensor;

struct Share {
  std::int64_t part = 0;
  std::int64_t all = 0;

  void add(const Tensor& lowered, const Tensor& among) {
    part += (lowered & among).sum().item<std::int64_t>();
    all += among.sum().item<std::int64_t>();
  }
  double value() const { return static_cast<double>(part) / static_cast<double>(all); }
};

}  // namespace

eval::Json report_moving(const mapping::RobustWeights& weights,
                         const mapping::KeyframeStore& keyframes,
                         const std::filesystem::path& folder, const SimulatedTruth* truth) {
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  Share every;
  Share moving;
  Share still;
  for (const std::size_t i : keyframes.training()) {
    const mapping::Keyframe& keyframe = keyframes[i];
    const Tensor lowered = weights.lowered(i, keyframe.image.size(0), keyframe.image.size(1)).cpu();
    const Tensor shown = lowered.to(torch::kUInt8) * 255;
    write_png(folder / (keyframe.name + ".png"), shown.unsqueeze(2).expand({-1, -1, 3}));
    every.add(lowered, torch::ones_like(lowered));
    const auto mask = truth != nullptr ? truth->moving(keyframe.name) : std::nullopt;
    if (!mask) continue;
    moving.add(lowered, *mask == 255);
    still.add(lowered, *mask == 0);
  }
  eval::Json json = eval::Json::object();
  if (every.all > 0) json["downweighted"] = every.value();
  if (moving.all > 0) json["downweighted_of_moving"] = moving.value();
  if (still.all > 0) json["downweighted_of_static"] = still.value();
  return json;
}

}  // namespace apvi::runs
