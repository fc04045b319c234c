// SPDX-License-Identifier: BSD-3-Clause
// Initial points from images with known poses.
#include <torch/torch.h>

#include <Eigen/Core>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <opencv2/core/utility.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "apvi/core/constants.hpp"
#include "core/status_line.hpp"
#include "gaussians/device.hpp"
#include "runs/maps/initial_points.hpp"
#include "slam/camera_conversion.hpp"

namespace apvi::runs {
namespace {

using Matrix34 = Eigen::Matrix<double, 3, 4>;

constexpr std::size_t kMaxImages = 400;      // more images of a dive mostly repeat the same scene
constexpr std::size_t kBatchSize = 16;       // images per update of the status line
constexpr int kMaxFeatures = 2000;           // per image
constexpr std::size_t kMatchesPerImage = 8;  // neighbors that each image is matched with
constexpr float kRatio = 0.8F;               // Lowe's ratio test
constexpr double kMaxEpipolarError_px = 2.0;
constexpr double kMaxReprojectionError_px = 2.0;
constexpr double kMinParallax_deg = 1.5;
constexpr double kMinBaseline_m = 0.03;
constexpr double kMaxRotation_deg = 60.0;  // SIFT matches little beyond

/// An image with its features. Pixels in the convention of `gaussians`.
struct FeatureImage {
  std::vector<Eigen::Vector2d> pixels;
  torch::Tensor descriptors;  ///< [n,128] float32 with integer values
  cv::Mat bgr;
  SE3 T_camera_world;
  gaussians::Intrinsics camera;

  Eigen::Matrix3d K() const {
    Eigen::Matrix3d matrix;
    matrix << camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0;
    return matrix;
  }
  Matrix34 projection() const { return K() * T_camera_world.matrix().topRows<3>(); }
  Eigen::Vector3d center() const { return T_camera_world.inverse().translation; }
};

FeatureImage make_feature_image(const mapping::Keyframe& keyframe, const cv::Mat& mask) {
  FeatureImage image;
  image.bgr = slam::to_image(keyframe.image);
  image.T_camera_world = slam::to_se3(keyframe.T_camera_world);
  image.camera = keyframe.intrinsics;
  cv::Mat gray;
  cv::cvtColor(image.bgr, gray, cv::COLOR_BGR2GRAY);
  std::vector<cv::KeyPoint> points;
  cv::Mat descriptors;
  cv::SIFT::create(kMaxFeatures)->detectAndCompute(gray, mask, points, descriptors);
  for (const cv::KeyPoint& point : points)
    image.pixels.emplace_back(point.pt.x + 0.5, point.pt.y + 0.5);
  image.descriptors = torch::empty({descriptors.rows, descriptors.cols});
  std::copy_n(descriptors.ptr<float>(), descriptors.total(), image.descriptors.data_ptr<float>());
  return image;
}

std::vector<FeatureImage> make_feature_images(const mapping::KeyframeStore& store) {
  const std::vector<std::size_t>& views = store.training();
  const std::size_t count = std::min(kMaxImages, views.size());
  std::vector<FeatureImage> images(count);
  StatusLine status("finding features");
  for (std::size_t begin = 0; begin < count; begin += kBatchSize) {
    const std::size_t end = std::min(count, begin + kBatchSize);
    cv::parallel_for_({static_cast<int>(begin), static_cast<int>(end)}, [&](const cv::Range& part) {
      for (auto i = static_cast<std::size_t>(part.start); i < static_cast<std::size_t>(part.end);
           ++i) {
        const std::size_t view = views[i * views.size() / count];
        images[i] =
            make_feature_image(store[view], slam::mask_of(store.scene(view, 1, torch::kCPU)));
      }
    });
    status.update(static_cast<double>(end) / static_cast<double>(count), "");
  }
  return images;
}

// Pairs to match: close in position and direction, with a minimum baseline.
std::set<std::pair<std::size_t, std::size_t>> choose_pairs(
    const std::vector<FeatureImage>& images) {
  std::set<std::pair<std::size_t, std::size_t>> pairs;
  for (std::size_t i = 0; i < images.size(); ++i) {
    std::vector<std::pair<double, std::size_t>> costs;
    for (std::size_t j = 0; j < images.size(); ++j) {
      const double baseline = (images[i].center() - images[j].center()).norm();
      const double rotation_deg =
          kDegreesPerRadian *
          images[i].T_camera_world.rotation.angularDistance(images[j].T_camera_world.rotation);
      if (j == i || baseline < kMinBaseline_m || rotation_deg > kMaxRotation_deg) continue;
      costs.emplace_back(baseline + rotation_deg / 30.0, j);  // 30 degrees count as one meter
    }
    std::sort(costs.begin(), costs.end());
    costs.resize(std::min(costs.size(), kMatchesPerImage));
    for (const auto& [cost, j] : costs) pairs.emplace(std::min(i, j), std::max(i, j));
  }
  return pairs;
}

// Fundamental matrix from the known poses: x_b^T F x_a = 0.
Eigen::Matrix3d fundamental(const FeatureImage& a, const FeatureImage& b) {
  const SE3 T_b_a = b.T_camera_world * a.T_camera_world.inverse();
  const Eigen::Vector3d t = T_b_a.translation;
  Eigen::Matrix3d cross;
  cross << 0.0, -t.z(), t.y(), t.z(), 0.0, -t.x(), -t.y(), t.x(), 0.0;
  return b.K().inverse().transpose() * cross * T_b_a.rotation.toRotationMatrix() * a.K().inverse();
}

// Squared distances and indices of the two nearest neighbors in `b` for each row of `a`, [n_a,2]
// each. Brute force as a matrix product: exact for integer descriptors, and faster than a tree.
std::pair<torch::Tensor, torch::Tensor> two_nearest(const torch::Tensor& a,
                                                    const torch::Tensor& b) {
  const torch::Tensor squared =
      torch::addmm(b.square().sum(1), a, b.t(), /*beta=*/1, /*alpha=*/-2) +
      a.square().sum(1, /*keepdim=*/true);
  const auto [distances, which] = squared.topk(2, 1, /*largest=*/false);
  return {distances.cpu(), which.cpu()};
}

std::vector<std::pair<std::size_t, std::size_t>> match(const FeatureImage& a,
                                                       const FeatureImage& b) {
  std::vector<std::pair<std::size_t, std::size_t>> matches;
  if (a.pixels.empty() || b.pixels.size() < 2) return matches;
  const torch::Device device = gaussians::active_device();
  const auto [squared, which] = two_nearest(a.descriptors.to(device), b.descriptors.to(device));
  const float* d = squared.data_ptr<float>();
  const std::int64_t* nearest = which.data_ptr<std::int64_t>();
  const Eigen::Matrix3d F = fundamental(a, b);
  for (std::size_t i = 0; i < a.pixels.size(); ++i) {
    if (d[2 * i] > kRatio * kRatio * d[2 * i + 1]) continue;
    const auto j = static_cast<std::size_t>(nearest[2 * i]);
    const Eigen::Vector3d line = F * a.pixels[i].homogeneous();
    if (std::abs(line.dot(b.pixels[j].homogeneous())) >
        kMaxEpipolarError_px * line.head<2>().norm())
      continue;
    matches.emplace_back(i, j);
  }
  return matches;
}

/// Union-find over features, with path halving.
class UnionFind {
 public:
  explicit UnionFind(std::size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), std::size_t{0});
  }
  std::size_t root(std::size_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(std::size_t a, std::size_t b) { parent_[root(a)] = root(b); }

 private:
  std::vector<std::size_t> parent_;
};

using Observation = std::pair<std::size_t, std::size_t>;  // image, feature

std::vector<std::vector<Observation>> find_tracks(const std::vector<FeatureImage>& images) {
  std::vector<std::size_t> first = {0};
  for (const FeatureImage& image : images) first.push_back(first.back() + image.pixels.size());
  UnionFind sets(first.back());
  StatusLine status("matching images");
  const auto pairs = choose_pairs(images);
  std::size_t done = 0;
  for (const auto& [i, j] : pairs) {
    for (const auto& [a, b] : match(images[i], images[j])) {
      sets.join(first[i] + a, first[j] + b);
    }
    status.update(static_cast<double>(++done) / static_cast<double>(pairs.size()), "");
  }
  std::map<std::size_t, std::vector<Observation>> tracks;
  for (std::size_t i = 0; i < images.size(); ++i) {
    for (std::size_t k = 0; k < images[i].pixels.size(); ++k) {
      tracks[sets.root(first[i] + k)].emplace_back(i, k);
    }
  }
  std::vector<std::vector<Observation>> result;
  for (auto& [root, track] : tracks) {
    if (track.size() >= 2) result.push_back(std::move(track));
  }
  return result;
}

bool is_consistent(const std::vector<FeatureImage>& images, const std::vector<Observation>& track,
                   const Eigen::Vector3d& point) {
  double max_parallax = 0.0;
  const Eigen::Vector3d first_ray = (point - images[track[0].first].center()).normalized();
  for (const auto& [i, k] : track) {
    const Eigen::Vector3d p = images[i].projection() * point.homogeneous();
    if (p.z() <= 0.0) return false;
    if ((p.hnormalized() - images[i].pixels[k]).norm() > kMaxReprojectionError_px) return false;
    const Eigen::Vector3d ray = (point - images[i].center()).normalized();
    max_parallax = std::max(max_parallax, std::acos(std::clamp(ray.dot(first_ray), -1.0, 1.0)));
  }
  return max_parallax * kDegreesPerRadian >= kMinParallax_deg;
}

// Linear triangulation from all views (Hartley and Zisserman, 12.2), rows scaled to pixels.
std::optional<Eigen::Vector3d> triangulate(const std::vector<FeatureImage>& images,
                                           const std::vector<Observation>& track) {
  Eigen::MatrixX4d A(2 * static_cast<Eigen::Index>(track.size()), 4);
  Eigen::Index row = 0;
  for (const auto& [i, k] : track) {
    const Matrix34 P = images[i].projection();
    const Eigen::Vector2d& x = images[i].pixels[k];
    A.row(row++) = (x.x() * P.row(2) - P.row(0)) / P.row(2).norm();
    A.row(row++) = (x.y() * P.row(2) - P.row(1)) / P.row(2).norm();
  }
  const Eigen::Matrix4d AtA = A.transpose() * A;
  const Eigen::Vector4d h =
      Eigen::JacobiSVD<Eigen::Matrix4d>(AtA, Eigen::ComputeFullV).matrixV().col(3);
  if (std::abs(h.w()) < 1e-12) return std::nullopt;
  const Eigen::Vector3d point = h.hnormalized();
  if (!is_consistent(images, track, point)) return std::nullopt;
  return point;
}

Eigen::Vector3d color_at(const FeatureImage& image, const Eigen::Vector2d& pixel) {
  const int u = std::clamp(static_cast<int>(pixel.x()), 0, image.bgr.cols - 1);
  const int v = std::clamp(static_cast<int>(pixel.y()), 0, image.bgr.rows - 1);
  const cv::Vec3b bgr = image.bgr.at<cv::Vec3b>(v, u);
  return Eigen::Vector3d(bgr[2], bgr[1], bgr[0]) / 255.0;
}

}  // namespace

gaussians::PointCloud triangulate_points(const mapping::KeyframeStore& store) {
  const std::vector<FeatureImage> images = make_feature_images(store);
  std::vector<float> positions;
  std::vector<float> colors;
  for (const auto& track : find_tracks(images)) {
    const auto point = triangulate(images, track);
    if (!point) continue;
    const Eigen::Vector3d color =
        color_at(images[track[0].first], images[track[0].first].pixels[track[0].second]);
    for (int axis = 0; axis < 3; ++axis) {
      positions.push_back(static_cast<float>((*point)[axis]));
      colors.push_back(static_cast<float>(color[axis]));
    }
  }
  const auto n = static_cast<std::int64_t>(positions.size() / 3);
  return {.positions = torch::from_blob(positions.data(), {n, 3}).clone(),
          .colors = torch::from_blob(colors.data(), {n, 3}).clone()};
}

}  // namespace apvi::runs
