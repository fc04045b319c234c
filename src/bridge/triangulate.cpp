// SPDX-License-Identifier: BSD-3-Clause
// The points a map begins with when there is nothing but images and poses.
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

#include "apvi/bridge/camera_conversion.hpp"
#include "apvi/bridge/initial_points.hpp"
#include "apvi/core/angles.hpp"
#include "apvi/core/progress.hpp"
#include "apvi/splat/device.hpp"

namespace apvi::bridge {
namespace {

using Matrix34 = Eigen::Matrix<double, 3, 4>;

constexpr std::size_t kPictures = 400;  // a dive has thousands, most of which see the same again
constexpr std::size_t kAtOnce = 16;     // whose features are looked for between two signs of life
constexpr int kFeatures = 2000;         // per image
constexpr std::size_t kNeighbours = 8;  // images that each is matched with
constexpr float kRatio = 0.8F;          // Lowe's test
constexpr double kEpipolarPx = 2.0;
constexpr double kReprojectionPx = 2.0;
constexpr double kLeastParallaxDeg = 1.5;
constexpr double kLeastBaselineM = 0.03;
constexpr double kMostTurnDeg = 60.0;  // SIFT finds little beyond

/// A picture with its features. Pixels in the convention of `splat`.
struct Picture {
  std::vector<Eigen::Vector2d> pixels;
  torch::Tensor descriptors;  ///< [n,128] whole numbers as float32
  cv::Mat bgr;
  SE3 T_camera_world;
  splat::Intrinsics camera;

  Eigen::Matrix3d K() const {
    Eigen::Matrix3d matrix;
    matrix << camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0;
    return matrix;
  }
  Matrix34 projection() const { return K() * T_camera_world.matrix().topRows<3>(); }
  Eigen::Vector3d center() const { return T_camera_world.inverse().translation; }
};

Picture make_picture(const mapping::Keyframe& keyframe) {
  Picture picture;
  picture.bgr = to_image(keyframe.image);
  picture.T_camera_world = to_se3(keyframe.T_camera_world);
  picture.camera = keyframe.intrinsics;
  cv::Mat grey;
  cv::cvtColor(picture.bgr, grey, cv::COLOR_BGR2GRAY);
  std::vector<cv::KeyPoint> points;
  cv::Mat found;
  cv::SIFT::create(kFeatures)->detectAndCompute(grey, cv::noArray(), points, found);
  for (const cv::KeyPoint& point : points)
    picture.pixels.emplace_back(point.pt.x + 0.5, point.pt.y + 0.5);
  picture.descriptors = torch::empty({found.rows, found.cols});
  std::copy_n(found.ptr<float>(), found.total(), picture.descriptors.data_ptr<float>());
  return picture;
}

std::vector<Picture> make_pictures(const mapping::KeyframeStore& store) {
  const std::vector<std::size_t>& views = store.training();
  const std::size_t count = std::min(kPictures, views.size());
  std::vector<Picture> pictures(count);
  StatusLine status("finding features");
  for (std::size_t begin = 0; begin < count; begin += kAtOnce) {
    const std::size_t end = std::min(count, begin + kAtOnce);
    cv::parallel_for_({static_cast<int>(begin), static_cast<int>(end)}, [&](const cv::Range& part) {
      for (auto i = static_cast<std::size_t>(part.start); i < static_cast<std::size_t>(part.end);
           ++i) {
        pictures[i] = make_picture(store[views[i * views.size() / count]]);
      }
    });
    status.update(static_cast<double>(end) / static_cast<double>(count), "");
  }
  return pictures;
}

// Pairs worth matching: near in place and direction, with some baseline.
std::set<std::pair<std::size_t, std::size_t>> choose_pairs(const std::vector<Picture>& pictures) {
  std::set<std::pair<std::size_t, std::size_t>> pairs;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    std::vector<std::pair<double, std::size_t>> costs;
    for (std::size_t j = 0; j < pictures.size(); ++j) {
      const double baseline = (pictures[i].center() - pictures[j].center()).norm();
      const double turn = kDegrees * pictures[i].T_camera_world.rotation.angularDistance(
                                         pictures[j].T_camera_world.rotation);
      if (j == i || baseline < kLeastBaselineM || turn > kMostTurnDeg) continue;
      costs.emplace_back(baseline + turn / 30.0, j);  // 30 degrees are as far as one metre
    }
    std::sort(costs.begin(), costs.end());
    costs.resize(std::min(costs.size(), kNeighbours));
    for (const auto& [cost, j] : costs) pairs.emplace(std::min(i, j), std::max(i, j));
  }
  return pairs;
}

// x_b^T F x_a = 0 from the known poses.
Eigen::Matrix3d fundamental(const Picture& a, const Picture& b) {
  const SE3 T_b_a = b.T_camera_world * a.T_camera_world.inverse();
  const Eigen::Vector3d t = T_b_a.translation;
  Eigen::Matrix3d cross;
  cross << 0.0, -t.z(), t.y(), t.z(), 0.0, -t.x(), -t.y(), t.x(), 0.0;
  return b.K().inverse().transpose() * cross * T_b_a.rotation.toRotationMatrix() * a.K().inverse();
}

// The two most alike of `b` for each of `a`, [n_a,2] each: squared distances and which. The whole
// table as a product of matrices: exact, as descriptors are whole numbers, and faster than a tree.
std::pair<torch::Tensor, torch::Tensor> two_nearest(const torch::Tensor& a,
                                                    const torch::Tensor& b) {
  const torch::Tensor squared =
      torch::addmm(b.square().sum(1), a, b.t(), /*beta=*/1, /*alpha=*/-2) +
      a.square().sum(1, /*keepdim=*/true);
  const auto [distances, which] = squared.topk(2, 1, /*largest=*/false);
  return {distances.cpu(), which.cpu()};
}

std::vector<std::pair<std::size_t, std::size_t>> match(const Picture& a, const Picture& b) {
  std::vector<std::pair<std::size_t, std::size_t>> matches;
  if (a.pixels.empty() || b.pixels.size() < 2) return matches;
  const torch::Device device = splat::active_device();
  const auto [squared, which] = two_nearest(a.descriptors.to(device), b.descriptors.to(device));
  const float* d = squared.data_ptr<float>();
  const std::int64_t* nearest = which.data_ptr<std::int64_t>();
  const Eigen::Matrix3d F = fundamental(a, b);
  for (std::size_t i = 0; i < a.pixels.size(); ++i) {
    if (d[2 * i] > kRatio * kRatio * d[2 * i + 1]) continue;
    const auto j = static_cast<std::size_t>(nearest[2 * i]);
    const Eigen::Vector3d line = F * a.pixels[i].homogeneous();
    if (std::abs(line.dot(b.pixels[j].homogeneous())) > kEpipolarPx * line.head<2>().norm())
      continue;
    matches.emplace_back(i, j);
  }
  return matches;
}

/// Features joined by matches, with path halving.
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

using Observation = std::pair<std::size_t, std::size_t>;  // picture, feature

std::vector<std::vector<Observation>> find_tracks(const std::vector<Picture>& pictures) {
  std::vector<std::size_t> first = {0};
  for (const Picture& picture : pictures) first.push_back(first.back() + picture.pixels.size());
  UnionFind sets(first.back());
  StatusLine status("matching images");
  const auto pairs = choose_pairs(pictures);
  std::size_t done = 0;
  for (const auto& [i, j] : pairs) {
    for (const auto& [a, b] : match(pictures[i], pictures[j])) {
      sets.join(first[i] + a, first[j] + b);
    }
    status.update(static_cast<double>(++done) / static_cast<double>(pairs.size()), "");
  }
  std::map<std::size_t, std::vector<Observation>> tracks;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    for (std::size_t k = 0; k < pictures[i].pixels.size(); ++k) {
      tracks[sets.root(first[i] + k)].emplace_back(i, k);
    }
  }
  std::vector<std::vector<Observation>> result;
  for (auto& [root, track] : tracks) {
    if (track.size() >= 2) result.push_back(std::move(track));
  }
  return result;
}

bool agrees(const std::vector<Picture>& pictures, const std::vector<Observation>& track,
            const Eigen::Vector3d& point) {
  double most_parallax = 0.0;
  const Eigen::Vector3d first_ray = (point - pictures[track[0].first].center()).normalized();
  for (const auto& [i, k] : track) {
    const Eigen::Vector3d p = pictures[i].projection() * point.homogeneous();
    if (p.z() <= 0.0) return false;
    if ((p.hnormalized() - pictures[i].pixels[k]).norm() > kReprojectionPx) return false;
    const Eigen::Vector3d ray = (point - pictures[i].center()).normalized();
    most_parallax = std::max(most_parallax, std::acos(std::clamp(ray.dot(first_ray), -1.0, 1.0)));
  }
  return most_parallax * kDegrees >= kLeastParallaxDeg;
}

// Linear triangulation from all views (Hartley and Zisserman, 12.2), rows scaled to pixels.
std::optional<Eigen::Vector3d> triangulate(const std::vector<Picture>& pictures,
                                           const std::vector<Observation>& track) {
  Eigen::MatrixX4d A(2 * static_cast<Eigen::Index>(track.size()), 4);
  Eigen::Index row = 0;
  for (const auto& [i, k] : track) {
    const Matrix34 P = pictures[i].projection();
    const Eigen::Vector2d& x = pictures[i].pixels[k];
    A.row(row++) = (x.x() * P.row(2) - P.row(0)) / P.row(2).norm();
    A.row(row++) = (x.y() * P.row(2) - P.row(1)) / P.row(2).norm();
  }
  const Eigen::Matrix4d AtA = A.transpose() * A;
  const Eigen::Vector4d h =
      Eigen::JacobiSVD<Eigen::Matrix4d>(AtA, Eigen::ComputeFullV).matrixV().col(3);
  if (std::abs(h.w()) < 1e-12) return std::nullopt;
  const Eigen::Vector3d point = h.hnormalized();
  if (!agrees(pictures, track, point)) return std::nullopt;
  return point;
}

Eigen::Vector3d color_at(const Picture& picture, const Eigen::Vector2d& pixel) {
  const int u = std::clamp(static_cast<int>(pixel.x()), 0, picture.bgr.cols - 1);
  const int v = std::clamp(static_cast<int>(pixel.y()), 0, picture.bgr.rows - 1);
  const cv::Vec3b bgr = picture.bgr.at<cv::Vec3b>(v, u);
  return Eigen::Vector3d(bgr[2], bgr[1], bgr[0]) / 255.0;
}

}  // namespace

splat::PointCloud triangulate_points(const mapping::KeyframeStore& store) {
  const std::vector<Picture> pictures = make_pictures(store);
  std::vector<float> positions;
  std::vector<float> colors;
  for (const auto& track : find_tracks(pictures)) {
    const auto point = triangulate(pictures, track);
    if (!point) continue;
    const Eigen::Vector3d color =
        color_at(pictures[track[0].first], pictures[track[0].first].pixels[track[0].second]);
    for (int axis = 0; axis < 3; ++axis) {
      positions.push_back(static_cast<float>((*point)[axis]));
      colors.push_back(static_cast<float>(color[axis]));
    }
  }
  const auto n = static_cast<std::int64_t>(positions.size() / 3);
  return {.positions = torch::from_blob(positions.data(), {n, 3}).clone(),
          .colors = torch::from_blob(colors.data(), {n, 3}).clone()};
}

}  // namespace apvi::bridge
