// SPDX-License-Identifier: BSD-3-Clause
// How much processor time a scene's pictures take, how many corners optical flow keeps from one to
// the next, and what they look like: sim_bench SCENE.yaml [SHEET.jpg [THREADS [COUNT]]].
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
#include "apvi/core/stopwatch.hpp"
#include "apvi/sim/renderer.hpp"
#include "apvi/sim/simulation.hpp"

namespace {

using namespace apvi;
using namespace apvi::sim;

// Corners of `first` that come back to where they were after being followed to `second` and back,
// and that stay within a pixel of where the scene says.
int kept_corners(const RenderedFrame& first, const cv::Mat& second, const CameraModel& camera,
                 const SE3& T_second_first) {
  cv::Mat a;
  cv::Mat b;
  cv::cvtColor(first.image, a, cv::COLOR_BGR2GRAY);
  cv::cvtColor(second, b, cv::COLOR_BGR2GRAY);
  std::vector<cv::Point2f> corners;
  cv::goodFeaturesToTrack(a, corners, 300, 0.01, 15.0);
  if (corners.empty()) return 0;
  std::vector<cv::Point2f> there;
  std::vector<uchar> found;
  cv::calcOpticalFlowPyrLK(a, b, corners, there, found, cv::noArray());
  int count = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const cv::Point pixel(cvRound(corners[i].x), cvRound(corners[i].y));
    const auto ray = camera.unproject({corners[i].x, corners[i].y});
    const double range = first.range.at<float>(pixel);
    if (!found[i] || !ray || range <= 0.0) continue;
    const auto expected = camera.project(T_second_first * Eigen::Vector3d(range * *ray));
    if (expected && (*expected - Eigen::Vector2d(there[i].x, there[i].y)).norm() < 1.0) ++count;
  }
  return count;
}

struct Shots {
  std::vector<cv::Mat> pictures;
  std::vector<int> kept;
  double core_seconds = 0.0;  ///< of all threads together
  int rendered = 0;
};

class Photographer {
 public:
  Photographer(const Scene& scene, const TriangleMesh& mesh, const RayCaster& world, int threads)
      : scene_(scene),
        events_(make_schedule(scene.config)),
        recording_(simulate_sensors(scene, events_, world)),
        camera_(scene.rig.cameras.front()),
        renderer_(mesh, world, camera_.model,
                  {scene.config.water, scene.config.light, scene.config.camera.effects},
                  scene.seed(), threads),
        threads_(threads) {}

  Shots shoot(int count) const {
    Shots shots;
    const std::size_t frames = recording_.frames.size();
    for (int k = 0; k < count; ++k) {
      const std::size_t at = std::min(
          frames - 2, static_cast<std::size_t>(k) * frames / static_cast<std::size_t>(count));
      const FrameTime& one = recording_.frames[at];
      const FrameTime& two = recording_.frames[at + 1];
      const std::clock_t start = std::clock();
      const RenderedFrame first = render(one);
      const cv::Mat second = render(two).image;
      shots.core_seconds += static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
      const SE3 T_second_first = pose(two.truth).inverse() * pose(one.truth);
      shots.kept.push_back(kept_corners(first, second, camera_.model, T_second_first));
      shots.pictures.push_back(first.image);
      shots.rendered += 2;
    }
    return shots;
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

cv::Mat contact_sheet(const std::vector<cv::Mat>& pictures, int columns) {
  constexpr int kWidth = 320;
  const int height = kWidth * pictures.front().rows / pictures.front().cols;
  const int rows = (static_cast<int>(pictures.size()) + columns - 1) / columns;
  cv::Mat sheet = cv::Mat::zeros(rows * height, columns * kWidth, CV_8UC3);
  for (int i = 0; i < static_cast<int>(pictures.size()); ++i) {
    const cv::Rect place(i % columns * kWidth, i / columns * height, kWidth, height);
    cv::resize(pictures[static_cast<std::size_t>(i)], sheet(place), place.size(), 0, 0,
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
  const Photographer photographer(scene, mesh, world, threads);
  const double baking = watch.seconds() - building;
  const Shots shots = photographer.shoot(count);
  fmt::print(
      "{}: {} triangles, world {:.1f} s, light {:.1f} s, {:.3f} core s a frame, corners kept:",
      args[0], mesh.triangles.size(), building, baking, shots.core_seconds / shots.rendered);
  for (const int kept : shots.kept) fmt::print(" {}", kept);
  fmt::print("\n");
  if (args.size() > 1) {
    cv::imwrite(args[1], contact_sheet(shots.pictures, 4), {cv::IMWRITE_JPEG_QUALITY, 82});
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
