// SPDX-License-Identifier: BSD-3-Clause
#include "runs/maps/tone_curve.hpp"

#include <algorithm>
#include <string>
#include <system_error>

#include "apvi/core/log.hpp"
#include "core/text.hpp"
#include "live/sources.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

bool is_jpeg(const fs::directory_entry& entry) {
  const std::string extension = text::to_lower(entry.path().extension().string());
  return extension == ".jpg" || extension == ".jpeg";
}

bool has_video(const std::vector<std::string>& addresses) {
  return std::any_of(addresses.begin(), addresses.end(), live::is_video_address);
}

}  // namespace

bool has_jpeg_images(const fs::path& recording) {
  for (const char* folder : {"mav0/cam0/data", "IMG_L"}) {
    std::error_code missing;
    const fs::directory_iterator files(recording / folder, missing);
    if (!missing && std::any_of(begin(files), end(files), is_jpeg)) return true;
  }
  return false;
}

RunConfig with_tone_curve(RunConfig config) {
  mapping::ToneCurveOptions& curve = config.mapping.trainer.tone_curve;
  if (curve.kind != mapping::ToneCurveKind::estimated) return config;
  const bool jpeg = has_jpeg_images(config.dataset.path);
  if (!jpeg && !has_video(config.live.sources)) return config;
  curve.kind = mapping::ToneCurveKind::srgb;
  log::info("{} images are made for viewing: the tone curve is taken as sRGB; for another set {}",
            jpeg ? "JPEG" : "video", "mapping.tone_curve.kind");
  return config;
}

}  // namespace apvi::runs
