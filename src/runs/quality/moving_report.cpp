// SPDX-License-Identifier: BSD-3-Clause
#include "runs/quality/moving_report.hpp"

#include <fmt/format.h>
#include <torch/torch.h>

#include <algorithm>
#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>
#include <ostream>
#include <string>

#include "core/atomic_file.hpp"
#include "runs/quality/simulated_truth.hpp"
#include "runs/views/image_files.hpp"

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

constexpr double kMinRegion = 1e-3;  // of the image

std::string rows_of(const std::string& image, const std::vector<MovingRegion>& regions) {
  std::string rows;
  for (const MovingRegion& r : regions) {
    rows += fmt::format("{},{},{},{},{},{}\n", image, r.left, r.top, r.width, r.height, r.pixels);
  }
  return rows;
}

}  // namespace

std::vector<MovingRegion> moving_regions(const Tensor& lowered) {
  const Tensor bytes = lowered.to(torch::kCPU, torch::kUInt8).contiguous();
  const cv::Mat mask(static_cast<int>(bytes.size(0)), static_cast<int>(bytes.size(1)), CV_8U,
                     bytes.data_ptr());
  cv::Mat labels;
  cv::Mat stats;
  cv::Mat centroids;
  const int count = cv::connectedComponentsWithStats(mask, labels, stats, centroids);
  std::vector<MovingRegion> regions;
  for (int i = 1; i < count; ++i) {  // the first one is the background
    const MovingRegion region{.left = stats.at<int>(i, cv::CC_STAT_LEFT),
                              .top = stats.at<int>(i, cv::CC_STAT_TOP),
                              .width = stats.at<int>(i, cv::CC_STAT_WIDTH),
                              .height = stats.at<int>(i, cv::CC_STAT_HEIGHT),
                              .pixels = stats.at<int>(i, cv::CC_STAT_AREA)};
    if (region.pixels >= kMinRegion * static_cast<double>(mask.total())) regions.push_back(region);
  }
  std::ranges::stable_sort(regions, std::greater{}, &MovingRegion::pixels);
  return regions;
}

eval::Json report_moving(const mapping::RobustWeights& weights,
                         const mapping::KeyframeStore& keyframes,
                         const std::filesystem::path& folder, const SimulatedTruth* truth) {
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  std::string csv = "#image,left_px,top_px,width_px,height_px,pixels\n";
  Share every;
  Share moving;
  Share still;
  for (const std::size_t i : keyframes.training()) {
    const mapping::Keyframe& keyframe = keyframes[i];
    const Tensor lowered = weights.lowered(i, keyframe.image.size(0), keyframe.image.size(1)).cpu();
    const Tensor shown = lowered.to(torch::kUInt8) * 255;
    write_png(folder / (keyframe.name + ".png"), shown.unsqueeze(2).expand({-1, -1, 3}));
    csv += rows_of(keyframe.name, moving_regions(lowered));
    every.add(lowered, torch::ones_like(lowered));
    const auto mask = truth != nullptr ? truth->moving(keyframe.name) : std::nullopt;
    if (!mask) continue;
    moving.add(lowered, *mask == 255);
    still.add(lowered, *mask == 0);
  }
  write_file_atomically(folder / "regions.csv", [&csv](std::ostream& out) { out << csv; });
  eval::Json json = eval::Json::object();
  if (every.all > 0) json["downweighted"] = every.value();
  if (moving.all > 0) json["downweighted_of_moving"] = moving.value();
  if (still.all > 0) json["downweighted_of_static"] = still.value();
  return json;
}

}  // namespace apvi::runs
