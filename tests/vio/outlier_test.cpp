// SPDX-License-Identifier: BSD-3-Clause
// Landmarks that do not fit the others.
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "support/simulated_dive.hpp"
#include "vio/window/window_update.hpp"

namespace apvi::vio {
namespace {

constexpr double kMaxError_px = 3.0;

/// Two frames at one place, in which corner i moved by `errors_px[i]`.
class TwoFrames {
 public:
  explicit TwoFrames(const std::vector<double>& errors_px)
      : rig_(test::SimulatedDive::rig()), window_(empty_window(rig_)) {
    const double focal = rig_.cameras.front().model.parameters().fx;
    for (int k = 0; k < 2; ++k) {
      auto frame = std::make_unique<Frame>();
      frame->stamp = Stamp{} + Duration::from_seconds(0.1 * k);
      TrackedFrame tracked{frame->stamp, {}, {}};
      for (std::size_t i = 0; i < errors_px.size(); ++i) {
        FeatureObservation seen;
        seen.id = static_cast<std::int64_t>(i);
        seen.point = {0.01 * static_cast<double>(i) + k * errors_px[i] / focal, 0.0};
        tracked.observations.push_back(seen);
      }
      window_.frames.push_back(std::move(frame));
      add_observations(window_, window_.newest(), tracked);
    }
    for (auto& [id, landmark] : window_.landmarks) landmark.inverse_depth = 0.5;
  }

  double limit_px() const { return outlier_limit_px(window_, rig_, kMaxError_px); }
  std::set<std::int64_t> rejected() {
    reject_outliers(window_, rig_, limit_px());
    return window_.rejected_tracks;
  }

 private:
  Rig rig_;
  Window window_;
};

TEST(Outliers, ALandmarkThatFitsWorseThanTheOthersIsRejected) {
  EXPECT_EQ(TwoFrames({0.2, 0.1, 1.4, 0.3, 0.2, 0.9}).rejected(), (std::set<std::int64_t>{2}));
}

TEST(Outliers, AnErrorOfAllLandmarksRejectsNone) {
  EXPECT_TRUE(TwoFrames({1.2, 0.8, 1.4, 1.3, 0.9}).rejected().empty());
}

TEST(Outliers, TheLimitIsOnePixelAtLeastAndTheConfiguredOneAtMost) {
  EXPECT_DOUBLE_EQ(TwoFrames({0.05, 0.1, 0.05}).limit_px(), 1.0);
  EXPECT_NEAR(TwoFrames({0.6, 0.5, 0.7}).limit_px(), 1.8, 1e-6);
  EXPECT_DOUBLE_EQ(TwoFrames({2.0, 2.5, 2.2}).limit_px(), kMaxError_px);
  EXPECT_DOUBLE_EQ(TwoFrames({}).limit_px(), kMaxError_px);
}

}  // namespace
}  // namespace apvi::vio
