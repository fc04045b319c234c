// SPDX-License-Identifier: BSD-3-Clause
#include "runs/quality/patch_colors.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "apvi/core/constants.hpp"
#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/io/tum.hpp"
#include "gaussians/render/tone_curve.hpp"
#include "io/folder/csv_file.hpp"
#include "io/recorded_images.hpp"
#include "mapping/appearance/display_exposure.hpp"
#include "runs/maps/local_origin.hpp"
#include "runs/maps/stored_map.hpp"
#include "slam/camera_conversion.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using Color = std::array<double, 3>;

constexpr double kMaxPoseGap_s = 0.1;

/// The recorded images that have patches, undistorted, by stamp.
std::map<std::int64_t, cv::Mat> images_of(const RunConfig& config,
                                          const std::vector<Patch>& patches) {
  std::map<std::int64_t, cv::Mat> images;
  for (const Patch& patch : patches) images.emplace(patch.stamp_ns, cv::Mat());
  const auto recording = io::open_sequence(config.dataset, {"camera"});
  std::size_t missing = images.size();
  io::for_each_image(*recording, 0, [&](const ImageFrame& frame) {
    const auto found = images.find(frame.stamp.ns);
    if (found == images.end()) return true;
    found->second = frame.decode();
    return --missing > 0;
  });
  return images;
}

/// Poses of the body by the stamp of exposure: those of the map, or else of localization.
class Poses {
 public:
  Poses(const fs::path& run, const map_io::Origin& origin) {
    for (const char* file : {"keyframes.tum", "trajectory_smoothed.tum", "trajectory.tum"}) {
      if (fs::exists(run / file)) all_.push_back(to_local(io::read_trajectory(run / file), origin));
    }
    if (all_.empty()) fail_input("{}: no keyframes.tum; is this a run folder?", run.string());
  }
  std::optional<SE3> at(Stamp stamp) const {
    for (const Trajectory& trajectory : all_) {
      if (auto pose = trajectory.at(stamp, Duration::from_seconds(kMaxPoseGap_s))) return pose;
    }
    return std::nullopt;
  }
  std::vector<gaussians::View> views(const CameraMount& mount) const {
    std::vector<gaussians::View> views;
    for (const StampedPose& pose : all_.front().poses)
      views.push_back(view_at(pose.T_world_body, mount));
    return views;
  }

 private:
  std::vector<Trajectory> all_;
};

/// Linear light [H,W,3] of an image and of the restored rendering from its pose.
struct ImageLight {
  torch::Tensor image;
  torch::Tensor restored;
};

// The rectangle in the undistorted image, [H,W] bool.
torch::Tensor mask_of(const Patch& patch, const cv::Size& size,
                      const slam::Undistorter& undistort) {
  cv::Mat mask = cv::Mat::zeros(size, CV_32F);
  const auto& [x, y, width, height] = patch.rectangle;
  mask(cv::Rect(x, y, width, height) & cv::Rect({}, size)) = 1.0F;
  const cv::Mat straight = undistort.nearest(mask);
  return torch::from_blob(straight.data, {straight.rows, straight.cols}, torch::kFloat32) > 0.5;
}

Color mean_of(const torch::Tensor& light, const torch::Tensor& mask) {
  const torch::Tensor mean =
      light.to(torch::kCPU, torch::kFloat64).index({mask}).reshape({-1, 3}).mean(0);
  return {mean[0].item<double>(), mean[1].item<double>(), mean[2].item<double>()};
}

double mean_angle(const std::vector<PatchColor>& patches, Color PatchColor::*color,
                  const Color& factors) {
  double sum = 0.0;
  for (const PatchColor& patch : patches) {
    Color balanced = patch.*color;
    for (std::size_t c = 0; c < 3; ++c) balanced[c] *= factors[c];
    sum += color_angle_deg(balanced, patch.reference);
  }
  return sum / static_cast<double>(patches.size());
}

// The geometric mean of reference / color.
Color white_balance(const std::vector<PatchColor>& patches, Color PatchColor::*color) {
  constexpr double kDark = 1e-6;
  Color factors{};
  for (std::size_t c = 0; c < 3; ++c) {
    double sum = 0.0;
    for (const PatchColor& patch : patches)
      sum += std::log(std::max(kDark, patch.reference[c]) / std::max(kDark, (patch.*color)[c]));
    factors[c] = std::exp(sum / static_cast<double>(patches.size()));
  }
  return factors;
}

double number(const io::CsvFile& csv, std::size_t column) {
  const auto value = csv.number(column);
  if (!value) fail_input("{}: column {}: no number", csv.where(), csv.column_name(column));
  return *value;
}

Patch read_patch(const io::CsvFile& csv, const std::array<std::size_t, 7>& columns) {
  Patch patch;
  const auto stamp = csv.stamp_ns();
  if (!stamp) fail_input("{}: no stamp of an image", csv.where());
  patch.stamp_ns = *stamp;
  for (std::size_t k = 0; k < 4; ++k)
    patch.rectangle[k] = static_cast<int>(std::lround(number(csv, columns[k])));
  if (patch.rectangle[2] < 1 || patch.rectangle[3] < 1)
    fail_input("{}: width and height must be at least 1", csv.where());
  for (std::size_t c = 0; c < 3; ++c) {
    const double value = number(csv, columns[4 + c]);
    if (value < 0.0 || value > 255.0) fail_input("{}: colors are from 0 to 255", csv.where());
    patch.reference[c] =
        gaussians::kSrgb.decode(torch::tensor(value / 255.0, torch::kFloat64)).item<double>();
  }
  return patch;
}

}  // namespace

std::vector<Patch> read_patches(const fs::path& file) {
  io::CsvFile csv(file);
  const std::array<std::size_t, 7> columns = {
      csv.require_column({"x"}),      csv.require_column({"y"}),   csv.require_column({"width"}),
      csv.require_column({"height"}), csv.require_column({"red"}), csv.require_column({"green"}),
      csv.require_column({"blue"})};
  std::vector<Patch> patches;
  while (csv.next()) patches.push_back(read_patch(csv, columns));
  if (patches.empty()) fail_input("{}: no patches", file.string());
  return patches;
}

double color_angle_deg(const Color& a, const Color& b) {
  double dot = 0.0;
  double squares_a = 0.0;
  double squares_b = 0.0;
  for (std::size_t c = 0; c < 3; ++c) {
    dot += a[c] * b[c];
    squares_a += a[c] * a[c];
    squares_b += b[c] * b[c];
  }
  const double cosine = dot / std::max(1e-12, std::sqrt(squares_a * squares_b));
  return std::acos(std::clamp(cosine, -1.0, 1.0)) * kDegreesPerRadian;
}

PatchErrors errors_of(const std::vector<PatchColor>& patches) {
  constexpr Color kNone = {1.0, 1.0, 1.0};
  PatchErrors errors{.patches = patches.size(),
                     .image_deg = mean_angle(patches, &PatchColor::image, kNone),
                     .restored_deg = mean_angle(patches, &PatchColor::restored, kNone),
                     .image_balanced_deg = {},
                     .restored_balanced_deg = {}};
  if (patches.size() < 2) return errors;
  const auto balanced = [&](Color PatchColor::*color) {
    return mean_angle(patches, color, white_balance(patches, color));
  };
  errors.image_balanced_deg = balanced(&PatchColor::image);
  errors.restored_balanced_deg = balanced(&PatchColor::restored);
  return errors;
}

eval::Json to_json(const PatchErrors& errors) {
  eval::Json json = {{"count", errors.patches},
                     {"image_angle_deg", errors.image_deg},
                     {"restored_angle_deg", errors.restored_deg}};
  if (errors.image_balanced_deg) json["image_balanced_angle_deg"] = *errors.image_balanced_deg;
  if (errors.restored_balanced_deg)
    json["restored_balanced_angle_deg"] = *errors.restored_balanced_deg;
  return json;
}

std::vector<PatchColor> measure_patches(const fs::path& run, const std::vector<Patch>& patches) {
  const torch::NoGradGuard no_grad;
  const RunConfig config = load_recorded_run_config(run / "resolved.yaml");
  const CameraMount mount = mount_of_run(config);
  const StoredMap stored = load_drawable_map(run);
  const Poses poses(run, stored.origin);
  const CameraCalibration camera = make_rig(config.rig).cameras.front();
  const slam::Undistorter undistort(camera.model, config.mapping.image_scale);
  const Duration delay = Duration::from_seconds(camera.time_offset_s);
  const mapping::DisplayExposure exposure =
      mapping::display_exposure(stored.map, poses.views(mount));
  const std::map<std::int64_t, cv::Mat> images = images_of(config, patches);
  std::map<std::int64_t, ImageLight> lights;
  std::vector<PatchColor> measured;
  for (const Patch& patch : patches) {
    const cv::Mat& image = images.at(patch.stamp_ns);
    const auto pose = poses.at(Stamp{patch.stamp_ns} - delay);
    if (image.empty() || !pose) {
      log::warning("patch in image {}: {}; left out", patch.stamp_ns,
                   image.empty() ? "no such image in the recording" : "no pose");
      continue;
    }
    const torch::Tensor mask = mask_of(patch, image.size(), undistort);
    if (!mask.any().item<bool>()) {
      log::warning("patch in image {}: outside of the map's image; left out", patch.stamp_ns);
      continue;
    }
    const auto [light, is_new] = lights.try_emplace(patch.stamp_ns);
    if (is_new) {
      const mapping::MapRendering drawn = mapping::render_map(stored.map, view_at(*pose, mount));
      const torch::Tensor values = slam::to_tensor(undistort(image)).to(torch::kFloat64) / 255.0;
      light->second = {.image = stored.map.tone_curve.decode(values),
                       .restored = mapping::exposed(drawn.restored, exposure)};
    }
    measured.push_back({.reference = patch.reference,
                        .image = mean_of(light->second.image, mask),
                        .restored = mean_of(light->second.restored, mask)});
  }
  if (measured.empty()) fail_input("{}: none of the patches could be measured", run.string());
  return measured;
}

}  // namespace apvi::runs
