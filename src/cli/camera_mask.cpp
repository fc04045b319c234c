// SPDX-License-Identifier: BSD-3-Clause
#include "cli/camera_mask.hpp"

#include <fmt/format.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <ostream>
#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/atomic_file.hpp"
#include "core/interrupt.hpp"
#include "core/status_line.hpp"
#include "doctor/static_parts.hpp"
#include "importer/image_encoder.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  io::DatasetConfig dataset;
  int camera = 0;
  std::size_t images = 200;
  fs::path output;
  fs::path preview;
};

void write_image(const fs::path& path, const cv::Mat& image) {
  const std::vector<std::uint8_t> bytes = importer::encode(image, {.png = true});
  write_file_atomically(path, [&bytes](std::ostream& out) {
    out.write(reinterpret_cast<const char*>(bytes.data()),
              static_cast<std::streamsize>(bytes.size()));
  });
}

// The mean of the images, with what the mask hides in red.
cv::Mat preview_of(const doctor::StaticParts& parts, const cv::Mat& mask) {
  cv::Mat color;
  cv::cvtColor(parts.mean_image(), color, cv::COLOR_GRAY2BGR);
  cv::Mat red(color.size(), CV_8UC3, cv::Scalar(0, 0, 255));
  cv::addWeighted(color, 0.5, red, 0.5, 0.0, red);
  red.copyTo(color, mask == 0);
  return color;
}

doctor::StaticParts find(const Arguments& a) {
  const InterruptGuard guard;
  StatusLine status("reading images");
  const auto parts =
      doctor::find_static_parts(a.dataset, {.camera = a.camera,
                                            .images = a.images,
                                            .progress = [&](double f) { status.update(f, ""); },
                                            .interrupted = [&] { return guard.interrupted(); }});
  if (guard.interrupted()) fail_run("interrupted");
  if (!parts) fail_input("{}: no readable images of cam{}", a.dataset.path, a.camera);
  if (parts->images() < doctor::StaticParts::kMinImages) {
    fail_input(
        "{}: only {} images differ from the one before; {} are needed while the vehicle moves",
        a.dataset.path, parts->images(), doctor::StaticParts::kMinImages);
  }
  return *parts;
}

void make_mask(const Arguments& a) {
  const doctor::StaticParts parts = find(a);
  const double share = parts.share();
  const cv::Mat mask = parts.mask();
  if (!a.preview.empty()) write_image(a.preview, preview_of(parts, mask));
  if (share == 0.0) {
    log::info("nothing in {} images is always at the same place; no mask is needed",
              parts.images());
    return;
  }
  if (share > doctor::StaticParts::kMaxShare) {
    fail_run("{:.0f} % of the image hardly changes: does the vehicle move in this recording?",
             100.0 * share);
  }
  write_image(a.output, mask);
  log::info("{:.1f} % of the image is static; look at {} and name it in the rig: cam{}.mask: {}",
            100.0 * share, a.output.string(), a.camera, a.output.filename().string());
}

}  // namespace

void add_camera_mask(CLI::App& camera) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* command = camera.add_subcommand(
      "mask", "find parts of the vehicle and overlays that a camera always sees");
  command->add_option("DATASET", a->dataset.path, "folder, or .bag, .mcap or .db3 file")
      ->type_name("FILE|FOLDER")
      ->required();
  command->add_option("-o,--output", a->output, "the mask, black where images are static")
      ->type_name("FILE")
      ->required();
  command->add_option("--preview", a->preview, "mean of the images, static parts in red")
      ->type_name("FILE");
  command->add_option("--camera", a->camera, "number of the camera")->check(CLI::Range(0, 1));
  command->add_option("--images", a->images, "most images that are read")
      ->check(CLI::Range(doctor::StaticParts::kMinImages, 100000));
  command->footer(
      "The vehicle must move in the recording. Static are edges that stay at the same pixels, and\n"
      "regions within them. Correct the mask in any image editor; black is hidden.");
  command->callback([a] { make_mask(*a); });
}

}  // namespace apvi::cli
