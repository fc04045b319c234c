// SPDX-License-Identifier: BSD-3-Clause
#include "doctor/image_pairs.hpp"

#include <algorithm>
#include <exception>

#include "apvi/sensors/rig.hpp"
#include "doctor/pair_collector.hpp"

namespace apvi::doctor {
namespace {

void add_frame(const ImageFrame& frame, ImagePairCollector& collector) {
  if (!collector.wants(frame.stamp)) return;
  try {
    collector.add(frame.decode(), frame.stamp);
  } catch (const std::exception&) {
    return;  // counted elsewhere
  }
}

}  // namespace

std::vector<std::vector<ImagePair>> match_images(const io::DatasetConfig& config,
                                                 const std::vector<TimeSpan>& spans,
                                                 const std::function<bool()>& interrupted) {
  const auto reader = io::open_sequence(config, {"camera"});
  const Rig rig = make_rig(reader->rig());
  std::vector<ImagePairCollector> collectors;
  for (const CameraCalibration& camera : rig.cameras) {
    const CameraModel::Parameters& p = camera.model.parameters();
    collectors.emplace_back(spans, cv::Size(p.width, p.height), camera.mask);
  }
  while (const auto event = reader->next()) {
    const auto* image = std::get_if<ImageFrame>(&*event);
    if (image == nullptr || image->camera < 0) continue;
    const auto camera = static_cast<std::size_t>(image->camera);
    if (camera < collectors.size()) add_frame(*image, collectors[camera]);
    if (interrupted && interrupted()) break;
    if (std::ranges::all_of(collectors, &ImagePairCollector::is_complete)) break;
  }
  std::vector<std::vector<ImagePair>> pairs;
  for (ImagePairCollector& collector : collectors) pairs.push_back(collector.take());
  return pairs;
}

}  // namespace apvi::doctor
