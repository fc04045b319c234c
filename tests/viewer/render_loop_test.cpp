// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/render_loop.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <nlohmann/json.hpp>

#include "apvi/core/error.hpp"

namespace apvi::viewer {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

// A wall in front of every view, 2 m away.
class WallScene : public Scene {
 public:
  std::optional<Rendering> render(const View& view) override {
    ++renders;
    if (failing) fail_run("no memory");
    if (work.count() > 0) std::this_thread::sleep_for(work);
    const cv::Size size(view.viewpoint.width, view.viewpoint.height);
    return Rendering{.color = cv::Mat(size, CV_8UC3, cv::Scalar(1, 2, 3)),
                     .depth = cv::Mat(size, CV_32F, cv::Scalar(2.0)),
                     .alpha = cv::Mat(size, CV_32F, cv::Scalar(1.0))};
  }
  std::optional<double> depth(const Viewpoint&, int column, int) override {
    if (column == 0) return std::nullopt;
    return 2.0;
  }
  std::uint64_t version() const override { return 1; }
  SceneDescription description() const override { return {}; }
  void pause(bool) override {}
  void save() override {}

  std::atomic<int> renders = 0;
  std::atomic<bool> failing = false;
  milliseconds work{0};
};

class Inbox {
 public:
  RenderLoop::Deliver deliver() {
    return [this](Outgoing message) {
      const std::scoped_lock lock(mutex_);
      messages_.push_back(std::move(message));
      arrived_.notify_all();
    };
  }
  std::optional<Outgoing> wait(std::size_t count = 1) {
    std::unique_lock lock(mutex_);
    if (!arrived_.wait_for(lock, std::chrono::seconds(10),
                           [&] { return messages_.size() >= count; })) {
      return std::nullopt;
    }
    return messages_[count - 1];
  }
  std::size_t size() {
    const std::scoped_lock lock(mutex_);
    return messages_.size();
  }

 private:
  std::mutex mutex_;
  std::condition_variable arrived_;
  std::vector<Outgoing> messages_;
};

ViewMessage view(std::uint32_t id, bool moving = false) {
  return {.id = id, .view = {.viewpoint = {.width = 64, .height = 48}}, .moving = moving};
}

TEST(RenderLoop, EveryWatcherGetsItsView) {
  WallScene scene;
  Inbox first, second;
  RenderLoop loop(scene, 1.0);
  loop.add(1, first.deliver());
  loop.add(2, second.deliver());
  loop.receive(1, view(11));
  loop.receive(2, view(22));
  ASSERT_TRUE(first.wait() && second.wait());
  EXPECT_TRUE(first.wait()->binary);
  EXPECT_EQ(first.wait()->data.at(8), 11);
  EXPECT_EQ(second.wait()->data.at(8), 22);
}

TEST(RenderLoop, AMeasurementIsAPointOfTheWorld) {
  WallScene scene;
  Inbox inbox;
  RenderLoop loop(scene, 1.0);
  loop.add(1, inbox.deliver());
  Viewpoint viewpoint{.width = 101, .height = 101, .focal = 1.0};
  viewpoint.T_world_camera.translation = {10, 0, 0};
  loop.receive(1, MeasureMessage{.id = 5, .viewpoint = viewpoint, .column = 100, .row = 50});
  loop.receive(1, MeasureMessage{.id = 6, .viewpoint = viewpoint, .column = 0, .row = 50});
  ASSERT_TRUE(inbox.wait(2));
  const auto point = nlohmann::json::parse(inbox.wait(1)->data).at("point");
  EXPECT_NEAR(point[0].get<double>(), 10.0 + 2.0 * 50.0 / 101.0, 1e-9);
  EXPECT_NEAR(point[1].get<double>(), 0.0, 1e-9);
  EXPECT_NEAR(point[2].get<double>(), 2.0, 1e-9);
  EXPECT_TRUE(nlohmann::json::parse(inbox.wait(2)->data).at("point").is_null());
}

TEST(RenderLoop, AViewThatCannotBeDrawnDoesNotEndIt) {
  WallScene scene;
  scene.failing = true;
  Inbox inbox;
  RenderLoop loop(scene, 1.0);
  loop.add(1, inbox.deliver());
  for (std::uint32_t id = 1; id < 6; ++id) {
    loop.receive(1, view(id));
    while (scene.renders < static_cast<int>(id)) std::this_thread::sleep_for(milliseconds(1));
  }
  scene.failing = false;
  loop.receive(1, view(9));
  ASSERT_TRUE(inbox.wait());
  EXPECT_EQ(inbox.wait()->data.at(8), 9);
}

TEST(RenderLoop, NothingIsDeliveredAfterRemoval) {
  WallScene scene;
  scene.work = milliseconds(20);
  Inbox inbox;
  RenderLoop loop(scene, 1.0);
  loop.add(1, inbox.deliver());
  loop.receive(1, view(1));
  while (scene.renders == 0) std::this_thread::sleep_for(milliseconds(1));
  loop.remove(1);
  const std::size_t before = inbox.size();
  std::this_thread::sleep_for(milliseconds(100));
  EXPECT_EQ(inbox.size(), before);
}

TEST(RenderLoop, DrawsInItsShareOfTheTime) {
  WallScene scene;
  scene.work = milliseconds(10);
  Inbox inbox;
  RenderLoop loop(scene, 0.2);
  loop.add(1, inbox.deliver());
  const auto began = steady_clock::now();
  for (std::uint32_t id = 1; id <= 10; ++id) {
    loop.receive(1, SnapshotMessage{.id = id, .view = view(id).view});
    ASSERT_TRUE(inbox.wait(id));
  }
  // 10 ms of work take 50 ms; the rest after the last one is not waited for.
  EXPECT_GT(steady_clock::now() - began, milliseconds(9 * 50));
}

}  // namespace
}  // namespace apvi::viewer
