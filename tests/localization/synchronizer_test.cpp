// SPDX-License-Identifier: BSD-3-Clause
#include "localization/synchronizer.hpp"

#include <gtest/gtest.h>

#include <functional>

#include "core/memory.hpp"

namespace apvi::localization {
namespace {

using Eigen::Vector3d;

constexpr std::int64_t kSecond = 1'000'000'000;

Rig make_test_rig() {
  Rig rig;
  rig.imu = ImuCalibration{};
  rig.dvl.emplace().beams = default_dvl_beams();
  rig.cameras.resize(1);
  return rig;
}

// Seven seconds at rest: IMU at 100 Hz, DVL at 5 Hz, and an image when `image_at` returns true
// (called at 100 Hz).
std::vector<FrameJob> jobs_at_rest(bool use_dvl, const std::function<bool(int)>& image_at) {
  Synchronizer synchronizer(dipo::Config{}, make_test_rig(), {.dvl = use_dvl, .cameras = 1});
  std::vector<FrameJob> jobs;
  const auto feed = [&](const SensorEvent& event) {
    for (FrameJob& job : synchronizer.process(event).frames) jobs.push_back(std::move(job));
  };
  for (int k = 0; k < 700; ++k) {
    const Stamp now{kSecond + k * kSecond / 100};
    if (image_at(k)) {
      ImageFrame image;
      image.stamp = now;
      image.decode = [] { return cv::Mat(); };
      feed(image);
    }
    feed(ImuSample{now, Vector3d::Zero(), Vector3d(0.0, 0.0, 9.80665)});
    if (k % 20 != 0) continue;
    DvlSample ping;
    ping.stamp = now;
    ping.valid = true;
    ping.velocity.x() =
        1e-4 * (k % 60);  // consecutive pings differ, otherwise they count as repeated
    feed(ping);
  }
  return jobs;
}

std::vector<int> without_image(const std::vector<FrameJob>& jobs) {
  std::vector<int> at;
  for (const FrameJob& job : jobs) {
    if (!job.images[0].decode)
      at.push_back(static_cast<int>((job.stamp.ns - kSecond) * 100 / kSecond));
  }
  return at;
}

TEST(Synchronizer, CreatesJobsWithoutImagesAt10HzDuringCameraOutage) {
  const auto image_at = [](int k) { return k % 5 == 0 && (k < 300 || k >= 500); };
  const std::vector<FrameJob> jobs = jobs_at_rest(true, image_at);
  const std::vector<int> bridged = without_image(jobs);
  ASSERT_FALSE(bridged.empty());
  EXPECT_EQ(bridged.front(), 345);  // half a second after the last image, at 295
  EXPECT_EQ(bridged.back(), 495);
  EXPECT_EQ(bridged.size(), 16U);
  for (std::size_t k = 1; k < jobs.size(); ++k) EXPECT_LT(jobs[k - 1].stamp, jobs[k].stamp);
  for (const FrameJob& job : jobs) {
    EXPECT_EQ(job.dipo.has_value(), job.stamp.ns > kSecond + 6 * kSecond / 10) << job.stamp.ns;
  }
}

TEST(Synchronizer, LowFrameRateIsNotACameraOutage) {
  EXPECT_TRUE(without_image(jobs_at_rest(true, [](int k) { return k % 100 == 0; })).empty());
}

TEST(Synchronizer, CreatesJobsWithoutImagesWhenCameraNeverStarts) {
  const std::vector<int> bridged = without_image(jobs_at_rest(true, [](int) { return false; }));
  ASSERT_FALSE(bridged.empty());
  EXPECT_EQ(bridged.front(), 200);  // two seconds after the first IMU sample
}

TEST(Synchronizer, CreatesNoJobsWithoutImagesWithoutDvl) {
  const auto image_at = [](int k) { return k % 5 == 0 && k < 300; };
  EXPECT_TRUE(without_image(jobs_at_rest(false, image_at)).empty());
}

// A dive of five hours at 100 Hz is 100 MiB of samples.
TEST(Synchronizer, KeepsNoSamplesWithoutACamera) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a sanitizer keeps what is freed";
#endif
  Synchronizer synchronizer(dipo::Config{}, make_test_rig(), {});
  const double before = peak_memory_mib();
  for (std::int64_t k = 0; k < 1'800'000; ++k) {
    const Stamp now{kSecond + k * kSecond / 100};
    synchronizer.process(ImuSample{now, Vector3d::Zero(), Vector3d(0.0, 0.0, 9.80665)});
  }
  EXPECT_LT(peak_memory_mib() - before, 40.0);
}

TEST(Synchronizer, KeepsAMinuteOfSamplesWhileTheCameraIsSilent) {
  Synchronizer synchronizer(dipo::Config{}, make_test_rig(), {.cameras = 1});
  std::vector<FrameJob> jobs;
  for (std::int64_t k = 0; k < 15'000; ++k) {
    const Stamp now{kSecond + k * kSecond / 100};
    if (k == 10 || k == 14'900) {
      ImageFrame image;
      image.stamp = now;
      image.decode = [] { return cv::Mat(); };
      synchronizer.process(image);
    }
    const SensorEvent sample = ImuSample{now, Vector3d::Zero(), Vector3d(0.0, 0.0, 9.80665)};
    for (FrameJob& job : synchronizer.process(sample).frames) jobs.push_back(std::move(job));
  }
  ASSERT_EQ(jobs.size(), 2U);
  EXPECT_GT(jobs[1].imu.size(), 100U);
  EXPECT_LE(jobs[1].imu.size(), 6000U);
}

TEST(Synchronizer, WaitsForNothingWithoutAnIMU) {
  Synchronizer synchronizer(dipo::Config{}, make_test_rig(), {.imu = false, .cameras = 1});
  ImageFrame image;
  image.stamp = Stamp{kSecond};
  image.decode = [] { return cv::Mat(); };
  const auto jobs = synchronizer.process(image).frames;
  ASSERT_EQ(jobs.size(), 1U);
  EXPECT_TRUE(jobs.front().imu.empty());
  EXPECT_FALSE(jobs.front().R_before_now);
}

}  // namespace
}  // namespace apvi::localization
