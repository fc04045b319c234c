// SPDX-License-Identifier: BSD-3-Clause
#include "runs/maps/posed_images.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "apvi/core/error.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

using testing::HasSubstr;

constexpr const char* kRig =
    "body: imu0\ncam0:\n  model: pinhole\n  intrinsics: [10, 10, 7.5, 5.5]\n  resolution: [16, "
    "12]\n"
    "  T_body_sensor: [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]\n";

/// A recording of a few gray images at 1 Hz.
class PosedImagesTest : public testing::Test {
 protected:
  void write_images(int count) {
    std::string csv = "#timestamp [ns],filename\n";
    for (int i = 0; i < count; ++i) {
      const std::string stamp = std::to_string((i + 1) * 1000000000LL);
      csv += stamp + "," + stamp + ".png\n";
      write_image(i, cv::Scalar(100 + i));
    }
    dir_.write("mav0/cam0/data.csv", csv);
    dir_.write("rig.yaml", kRig);
  }
  void write_image(int i, const cv::Scalar& color, cv::Size size = {16, 12}) {
    const auto file =
        dir_.write("mav0/cam0/data/" + std::to_string((i + 1) * 1000000000LL) + ".png", "");
    cv::imwrite(file.string(), cv::Mat(size, CV_8U, color));
  }
  void write_poses(int first, int count) {
    std::string csv = "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w,q_x,q_y,q_z\n";
    for (int i = first; i < first + count; ++i) {
      csv += std::to_string((i + 1) * 1000000000LL) + "," + std::to_string(i) + ",0,0,1,0,0,0\n";
    }
    dir_.write("mav0/state_groundtruth_estimate0/data.csv", csv);
  }
  RunConfig config() const {
    RunConfig config;
    config.dataset.path = dir_.path().string();
    config.eval.heldout_every = 3;
    return config;
  }
  std::string error_of(const RunConfig& c) {
    try {
      load_posed_images(c);
    } catch (const InputError& e) {
      return e.what();
    }
    return "no error";
  }

  test::TmpDir dir_;
};

TEST_F(PosedImagesTest, HoldsOutEveryThirdImageFromTheFirst) {
  write_images(7);
  write_poses(0, 7);
  const PosedImages images = load_posed_images(config());
  ASSERT_EQ(images.store.size(), 7U);
  EXPECT_EQ(images.store.held_out(), (std::vector<std::size_t>{0, 3, 6}));
  EXPECT_EQ(images.store[2].image[3][4][1].item<int>(), 102);
  EXPECT_DOUBLE_EQ(images.store[2].T_camera_world[0][3].item<double>(), -2.0);
  EXPECT_DOUBLE_EQ(images.store[2].intrinsics.cx, 8.0);
}

TEST_F(PosedImagesTest, CountsUnusableImagesWithoutShiftingHeldOutOnes) {
  write_images(7);
  write_poses(1, 6);
  write_image(2, cv::Scalar(1));
  write_image(4, cv::Scalar(99), {8, 8});
  dir_.write("mav0/cam0/data/6000000000.png", "no image");
  const PosedImages images = load_posed_images(config());
  EXPECT_EQ(images.missing_pose, 1U);
  EXPECT_EQ(images.black, 1U);
  EXPECT_EQ(images.damaged, 2U);
  ASSERT_EQ(images.store.size(), 3U);  // images 1, 3 and 6 of the recording
  EXPECT_EQ(images.store.held_out(), (std::vector<std::size_t>{1, 2}));
}

TEST_F(PosedImagesTest, RejectsRecordingWithoutPoses) {
  write_images(2);
  EXPECT_THAT(error_of(config()), HasSubstr("set localization.poses_file"));
}

TEST_F(PosedImagesTest, RejectsPosesWithoutTimeOverlap) {
  write_images(3);
  dir_.write("mav0/state_groundtruth_estimate0/data.csv",
             "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w,q_x,q_y,q_z\n9,0,0,0,1,0,0,0\n");
  EXPECT_THAT(error_of(config()), HasSubstr("none of 3 images is usable: 3 without a pose"));
}

TEST_F(PosedImagesTest, LoadsGivenPosesFromFile) {
  write_images(3);
  RunConfig with_file = config();
  with_file.localization.poses_file =
      dir_.write("poses.tum", "1 5 0 0 0 0 0 1\n2 6 0 0 0 0 0 1\n3 7 0 0 0 0 0 1\n").string();
  const PosedImages images = load_posed_images(with_file);
  ASSERT_EQ(images.store.size(), 3U);
  EXPECT_DOUBLE_EQ(images.store[0].T_camera_world[0][3].item<double>(), -5.0);
}

TEST_F(PosedImagesTest, LoadsOnlyTheImagesWithAPoseOfTheirOwn) {
  write_images(7);
  Trajectory poses;
  for (const int i : {1, 3, 6}) {
    poses.poses.push_back(
        {Stamp{(i + 1) * 1000000000LL}, SE3{Eigen::Quaterniond::Identity(), {10.0 + i, 0.0, 0.0}}});
  }
  const PosedImages images = load_posed_images(config(), {.poses_of_images = poses});
  ASSERT_EQ(images.store.size(), 3U);
  EXPECT_DOUBLE_EQ(images.store[1].T_camera_world[0][3].item<double>(), -13.0);
  EXPECT_EQ(images.store.held_out(), (std::vector<std::size_t>{1, 2}));  // 3 and 6
  EXPECT_EQ(images.missing_pose, 0U);
}

TEST_F(PosedImagesTest, ACacheHasWhatWasLoadedAsFarAsItFits) {
  write_images(4);
  write_poses(0, 4);
  ImageCache cache(3 * 16 * 12 * 3);
  const PosedImages first = load_posed_images(config(), {.cache = &cache});
  for (int i = 0; i < 4; ++i) write_image(i, cv::Scalar(200));
  const PosedImages again = load_posed_images(config(), {.cache = &cache});
  ASSERT_EQ(again.store.size(), 4U);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_TRUE(torch::equal(again.store[i].image, first.store[i].image)) << i;
  }
  EXPECT_EQ(again.store[3].image.max().item<int>(), 200);  // did not fit, is read again
}

TEST_F(PosedImagesTest, PosesFarFromZeroAreRelativeToRoundedCentroid) {
  write_images(3);
  RunConfig far = config();
  far.localization.poses_file = dir_.write("poses.tum",
                                           "1 596010.25 6640030 -7 0 0 0 1\n"
                                           "2 596011.25 6640030 -7 0 0 0 1\n"
                                           "3 596012.25 6640030 -7 0 0 0 1\n")
                                    .string();
  const PosedImages images = load_posed_images(far);
  EXPECT_EQ(images.origin, (map_io::Origin{596000.0, 6640000.0, 0.0}));
  EXPECT_DOUBLE_EQ(images.store[0].T_camera_world[0][3].item<double>(), -10.25);
  EXPECT_DOUBLE_EQ(images.store[0].T_camera_world[1][3].item<double>(), -30.0);
  const PosedImages fixed =
      load_posed_images(far, {.origin = map_io::Origin{596010.0, 6640030.0, 0.0}});
  EXPECT_DOUBLE_EQ(fixed.store[0].T_camera_world[0][3].item<double>(), -0.25);
}

TEST_F(PosedImagesTest, PosesWithinOneKilometerKeepTheirCoordinates) {
  write_images(2);
  RunConfig near = config();
  near.localization.poses_file =
      dir_.write("poses.tum", "1 900 0 0 0 0 0 1\n2 901 0 0 0 0 0 1\n").string();
  const PosedImages images = load_posed_images(near);
  EXPECT_TRUE(map_io::is_zero(images.origin));
  EXPECT_DOUBLE_EQ(images.store[0].T_camera_world[0][3].item<double>(), -900.0);
}

TEST_F(PosedImagesTest, ReportsMissingPath) {
  RunConfig missing;
  missing.dataset.path = "/nowhere/at/all";
  EXPECT_THAT(error_of(missing), HasSubstr("/nowhere/at/all"));
  missing.dataset.path.clear();
  EXPECT_THAT(error_of(missing), HasSubstr("dataset.path: missing"));
}

TEST_F(PosedImagesTest, MasksAreThoseOfTheRigAndOfTheImages) {
  write_images(3);
  write_poses(0, 3);
  cv::Mat gripper(12, 16, CV_8U, cv::Scalar(255));
  gripper.rowRange(9, 12).setTo(0);
  cv::Mat diver(12, 16, CV_8U, cv::Scalar(255));
  diver.colRange(0, 4).setTo(0);
  cv::imwrite(dir_.write("gripper.png", "").string(), gripper);
  const auto scene = [&](std::size_t i) {
    return load_posed_images(config()).store.scene(i, 1, torch::kCPU);
  };
  EXPECT_FALSE(scene(0).defined());
  dir_.write("rig.yaml", std::string(kRig) + "  mask: gripper.png\n");
  cv::imwrite(dir_.write("mav0/cam0/masks/2000000000.png", "").string(), diver);
  ASSERT_TRUE(scene(0).defined());
  EXPECT_EQ(scene(0).sum().item<int>(), 9 * 16);
  EXPECT_EQ(scene(1).sum().item<int>(), 9 * 12);
}

}  // namespace
}  // namespace apvi::runs
