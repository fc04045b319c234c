// SPDX-License-Identifier: BSD-3-Clause
#include "runs/quality/simulated_truth.hpp"

#include <torch/torch.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

constexpr int kPartlyMoving = 128;  // like a shadow

// Empty when the file does not exist; avoids OpenCV's warning.
cv::Mat read_image(const fs::path& file, int how) {
  return fs::exists(file) ? cv::imread(file.string(), how) : cv::Mat();
}

torch::Tensor numbers(const nlohmann::json& json, const char* key) {
  return torch::tensor(json.at(key).get<std::vector<double>>(), torch::kFloat64);
}

}  // namespace

SimulatedTruth::SimulatedTruth(fs::path folder, slam::Undistorter undistort)
    : folder_(std::move(folder)), undistort_(std::move(undistort)) {}

std::optional<SimulatedTruth> SimulatedTruth::open(const fs::path& recording,
                                                   const CameraModel& camera, double scale) {
  const fs::path folder = recording / "truth";
  if (!fs::is_directory(folder)) return std::nullopt;
  return SimulatedTruth(folder, slam::Undistorter(camera, scale));
}

std::optional<torch::Tensor> SimulatedTruth::depth(const std::string& stamp) const {
  const cv::Mat image = read_image(folder_ / "depth" / (stamp + ".pfm"), cv::IMREAD_UNCHANGED);
  if (image.empty() || image.type() != CV_32F) return std::nullopt;
  const cv::Mat depth = undistort_.nearest(image);
  return torch::from_blob(depth.data, {depth.rows, depth.cols}, torch::kFloat32).clone();
}

std::optional<torch::Tensor> SimulatedTruth::clear(const std::string& stamp) const {
  const cv::Mat image = read_image(folder_ / "clear" / (stamp + ".png"), cv::IMREAD_COLOR);
  if (image.empty()) return std::nullopt;
  return slam::to_tensor(undistort_(image));
}

std::optional<torch::Tensor> SimulatedTruth::moving(const std::string& stamp) const {
  const cv::Mat image = read_image(folder_ / "moving" / (stamp + ".png"), cv::IMREAD_GRAYSCALE);
  if (image.empty()) return std::nullopt;
  cv::Mat mask = undistort_.nearest(image);
  mask.setTo(kPartlyMoving, (undistort_(image) > 0) & (mask == 0));
  return torch::from_blob(mask.data, {mask.rows, mask.cols}, torch::kUInt8).clone();
}

std::optional<OffPathView> SimulatedTruth::off_path(const std::string& stamp) const {
  const fs::path file = folder_ / "off_path" / (stamp + ".json");
  std::ifstream in(file);
  if (!in) return std::nullopt;
  cv::Mat image;
  for (const char* extension : {".jpg", ".png"}) {
    if (image.empty())
      image = read_image(fs::path(file).replace_extension(extension), cv::IMREAD_COLOR);
  }
  if (image.empty()) return std::nullopt;
  try {
    const torch::Tensor T = numbers(nlohmann::json::parse(in), "T_camera_view");
    return OffPathView{.image = slam::to_tensor(undistort_(image)),
                       .T_camera_view = T.view({4, 4})};
  } catch (const std::exception& e) {
    fail_input("{}: {}", file.string(), e.what());
  }
}

bool SimulatedTruth::has_own_exposure() const {
  return fs::exists(folder_ / "camera.json");  // spectral physics
}

std::optional<medium::Medium> SimulatedTruth::medium() const {
  const fs::path file = folder_ / "medium.json";
  std::ifstream in(file);
  if (!in) return std::nullopt;
  try {
    const auto json = nlohmann::json::parse(in);
    return medium::Medium{.beta_d = numbers(json, "beta_d"),
                          .beta_b = numbers(json, "beta_b"),
                          .b_inf = numbers(json, "b_inf")};
  } catch (const nlohmann::json::exception& e) {
    fail_input("{}: {}", file.string(), e.what());
  }
}

}  // namespace apvi::runs
