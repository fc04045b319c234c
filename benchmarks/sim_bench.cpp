// SPDX-License-Identifier: BSD-3-Clause
// CPU time per rendered image of a scene, number of corners that optical flow tracks to the next
// image, and a contact sheet of the images: sim_bench SCENE.yaml [SHEET.jpg [THREADS [COUNT]]].
#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "core/stopwatch.hpp"
#include "sim/render/renderer.hpp"
#include "sim/simulation.hpp"

namespace {

using namespace apvi;
using namespace apvi::sim;

// Number of corners of `first` that optical flow tracks to within one pixel of their true position
// in `second`.
int tracked_corners(const RenderedFrame& first, const cv::Mat& second, const CameraModel& camera,
                    const SE3& T_second_first) {
  cv::Mat a;
  cv::Mat b;
  cv::cvtColor(first.image, a, cv::COLOR_BGR2GRAY);
  cv::cvtColor(second, b, cv::COLOR_BGR2GRAY);
  std::vector<cv::Point2f> corners;
  cv::goodFeaturesToTrack(a, corners, 300, 0.01, 15.0);
  if (corners.empty()) return 0;
  std::vector<cv::Point2f> moved;
  std::vector<uchar> found;
  cv::calcOpticalFlowPyrLK(a, b, corners, moved, found, cv::noArray());
  int count = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const cv::Point pixel(cvRound(corners[i].x), cvRound(corners[i].y));
    const auto ray = camera.unproject({corners[i].x, corners[i].y});
    const double range = first.range.at<float>(pixel);
    if (!found[i] || !ray || range <= 0.0) continue;
    const auto expected = camera.project(T_second_first * Eigen::Vector3d(range * *ray));
    if (expected && (*expected - Eigen::Vector2d(moved[i].x, moved[i].y)).norm() < 1.0) ++count;
  }
  return count;
}

struct FramePairs {
  std::vector<cv::Mat> images;
  std::vector<int> tracked;
  double core_seconds = 0.0;  ///< sum over all threads
  int rendered = 0;
};

class FramePairRenderer {
 public:
  FramePairRenderer(const Scene& scene, const TriangleMesh& mesh, const RayCaster& world,
                    int threads)
      : scene_(scene),
        events_(make_schedule(scene.config)),
        recording_(simulate_sensors(scene, events_, world)),
        camera_(scene.rig.cameras.front()),
        renderer_(mesh, world, camera_.model,
                  {scene.config.water, scene.config.light, scene.config.camera.effects},
                  scene.seed(), threads),
        threads_(threads) {}

  FramePairs render_pairs(int count) const {
    FramePairs pairs;
    const std::size_t frames = recording_.frames.size();
    for (int k = 0; k < count; ++k) {
      const std::size_t at = std::min(
          frames - 2, static_cast<std::size_t>(k) * frames / static_cast<std::size_t>(count));
      const FrameTime& one = recording_.frames[at];
      const FrameTime& two = recording_.frames[at + 1];
      const std::clock_t start = std::clock();
      const RenderedFrame first = render(one);
      const cv::Mat second = render(two).image;
      pairs.core_seconds += static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
      const SE3 T_second_first = pose(two.truth).inverse() * pose(one.truth);
      pairs.tracked.push_back(tracked_corners(first, second, camera_.model, T_second_first));
      pairs.images.push_back(first.image);
      pairs.rendered += 2;
    }
    return pairs;
  }

 private:
  SE3 pose(Stamp stamp) const {
    return recording_.spline.at(stamp).T_world_body * camera_.T_body_camera;
  }
  RenderedFrame render(const FrameTime& frame) const {
    ImageRequest request;
    request.stamp = frame.truth;
    request.frame = frame.index;
    request.T_world_camera = [this](Stamp stamp) { return pose(stamp); };
    request.disturbance = events_.disturbance(seconds_between(kSimulationStart, frame.truth));
    return renderer_.render(request, threads_);
  }

  const Scene& scene_;
  EventSchedule events_;
  Recording recording_;
  CameraCalibration camera_;
  Renderer renderer_;
  int threads_;
};

cv::Mat contact_sheet(const std::vector<cv::Mat>& images, int columns) {
  constexpr int kWidth = 320;
  const int height = kWidth * images.front().rows / images.front().cols;
  const int rows = (static_cast<int>(images.size()) + columns - 1) / columns;
  cv::Mat sheet = cv::Mat::zeros(rows * height, columns * kWidth, CV_8UC3);
  for (int i = 0; i < static_cast<int>(images.size()); ++i) {
    const cv::Rect place(i % columns * kWidth, i / columns * height, kWidth, height);
    cv::resize(images[static_cast<std::size_t>(i)], sheet(place), place.size(), 0, 0,
               cv::INTER_AREA);
  }
  return sheet;
}

int run(const std::vector<std::string>& args) {
  if (args.empty()) fail_input("usage: sim_bench SCENE.yaml [SHEET.jpg [THREADS [COUNT]]]");
  const int threads = args.size() > 2 ? std::atoi(args[2].c_str()) : 2;
  const int count = args.size() > 3 ? std::max(2, std::atoi(args[3].c_str())) : 16;
  const Scene scene = load_scene(args[0]);
  Stopwatch watch;
  const TriangleMesh mesh = make_world(scene.config.world, scene.seed());
  const RayCaster world(mesh);
  const double building = watch.seconds();
  const FramePairRenderer pair_renderer(scene, mesh, world, threads);
  const double baking = watch.seconds() - building;
  const FramePairs pairs = pair_renderer.render_pairs(count);
  fmt::print(
      "{}: {} triangles, world {:.1f} s, light {:.1f} s, {:.3f} core s per frame, corners tracked:",
      args[0], mesh.triangles.size(), building, baking, pairs.core_seconds / pairs.rendered);
  for (const int tracked : pairs.tracked) fmt::print(" {}", tracked);
  fmt::print("\n");
  if (args.size() > 1) {
    cv::imwrite(args[1], contact_sheet(pairs.images, 4), {cv::IMWRITE_JPEG_QUALITY, 82});
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run({argv + 1, argv + argc});
  } catch (const std::exception& error) {
    fmt::print(stderr, "{}\n", error.what());
    return 2;
  }
}
