// SPDX-License-Identifier: BSD-3-Clause
#include "runs/warnings.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "eval/metrics_file.hpp"
#include "runs/run.hpp"
#include "support/dive_folder.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

Rig full_rig() {
  Rig rig;
  rig.imu = ImuCalibration{};
  rig.dvl = DvlCalibration{};
  rig.depth = PressureDepthCalibration{};
  return rig;
}

// A run in which every sensor served.
Evidence good_evidence() {
  Evidence evidence;
  evidence.sensors_in_use = {"camera", "imu", "dvl", "pressure"};
  for (const char* kind : {"imu", "dvl", "depth", "camera"}) evidence.streams[kind].delivered = 100;
  evidence.images = {{.images = 100}};
  evidence.vio = VioService{.frames = 100, .with_pose = 90, .used = 80};
  AcousticService acoustic;
  acoustic.counts.pings = {{dipo::Verdict::accepted, 95}, {dipo::Verdict::rejected, 5}};
  acoustic.counts.depths = {{dipo::Verdict::accepted, 100}};
  acoustic.max_accel_factor = 300.0;
  evidence.acoustic = acoustic;
  for (int i = 0; i < 100; ++i) {
    evidence.samples.add(ImuSample{Stamp{i}, {0.1, 0.0, 0.0}, {0.0, 0.0, 9.8}});
    DvlSample ping;
    ping.velocity.x() = 0.5;
    ping.valid = true;
    evidence.samples.add(ping);
  }
  return evidence;
}

Trajectory straight(double speed, int seconds = 20) {
  Trajectory trajectory;
  for (int i = 0; i <= 10 * seconds; ++i) {
    trajectory.poses.push_back(
        {Stamp{100'000'000LL * i}, SE3{Eigen::Quaterniond::Identity(), {0.1 * i * speed, 0, 0}}});
  }
  return trajectory;
}

std::vector<std::string> warnings_of(const Evidence& evidence) {
  return check_inputs(evidence, full_rig());
}

TEST(InputWarnings, SensorsThatServedAreNotMentioned) {
  EXPECT_THAT(warnings_of(good_evidence()), IsEmpty());
  EXPECT_TRUE(vio_served(good_evidence()));
  EXPECT_TRUE(dipo_served(good_evidence()));
}

TEST(InputWarnings, NameStreamsWithoutUsableSamples) {
  Evidence evidence = good_evidence();
  evidence.streams["depth"] = {.delivered = 0,
                               .dropped = {{io::DropReason::malformed, 7}},
                               .first_drop = {{io::DropReason::malformed, "data.csv:2"}}};
  evidence.streams["dvl"] = {};
  EXPECT_THAT(warnings_of(evidence),
              ElementsAre(AllOf(HasSubstr("depth: 7 of 7"), HasSubstr("data.csv:2")),
                          HasSubstr("dvl: recorded without a sample")));
  evidence.sensors_in_use = {"camera", "imu"};
  EXPECT_THAT(warnings_of(evidence), IsEmpty());
}

TEST(InputWarnings, NameAClockThatWasSet) {
  Evidence evidence = good_evidence();
  io::StreamReport& imu = evidence.streams["imu"];
  imu.dropped[io::DropReason::out_of_order] = 40;
  imu.first_drop[io::DropReason::out_of_order] = "data.csv:4002";
  EXPECT_THAT(warnings_of(evidence), IsEmpty());  // neighbors that were swapped
  imu.largest_step_back = Duration::from_seconds(2.0);
  EXPECT_THAT(warnings_of(evidence),
              ElementsAre(AllOf(HasSubstr("imu: 40 samples lie up to 2.0 s before earlier ones"),
                                HasSubstr("data.csv:4002"))));
  imu = {.delivered = 100,
         .dropped = {{io::DropReason::broken_stamp, 20}},
         .first_drop = {{io::DropReason::broken_stamp, "data.csv:7"}}};
  EXPECT_THAT(warnings_of(evidence), ElementsAre(HasSubstr("its clock was set")));
}

TEST(InputWarnings, NameVioThatServedFewImages) {
  Evidence evidence = good_evidence();
  evidence.vio = VioService{.frames = 9, .with_pose = 3, .used = 1};
  EXPECT_THAT(warnings_of(evidence), ElementsAre(HasSubstr("only 1 of 9 images")));
}

TEST(InputWarnings, NameRecordedSensorsThatTheRigDoesNotDescribe) {
  Rig rig = full_rig();
  rig.depth.reset();
  EXPECT_THAT(check_inputs(good_evidence(), rig),
              ElementsAre(HasSubstr("does not describe depth0")));
}

TEST(InputWarnings, NameACameraWithoutUsableImages) {
  Evidence evidence = good_evidence();
  evidence.images = {{.images = 100,
                      .undecodable = 0,
                      .wrong_size = 100,
                      .first_undecodable = "",
                      .first_wrong_size = "an image has 376 x 240 px"}};
  EXPECT_THAT(warnings_of(evidence), ElementsAre(HasSubstr("cam0: 100 of 100 images")));
  evidence.images = {{.images = 100,
                      .undecodable = 60,
                      .wrong_size = 0,
                      .first_undecodable = "a.png: damaged",
                      .first_wrong_size = ""}};
  EXPECT_THAT(warnings_of(evidence), ElementsAre(HasSubstr("first: a.png: damaged")));
  evidence.images[0].undecodable = 3;  // single damaged images are counted only
  EXPECT_THAT(warnings_of(evidence), IsEmpty());
}

TEST(InputWarnings, NameVioThatNeverInitializedOrWasNeverAccepted) {
  Evidence evidence = good_evidence();
  evidence.vio = VioService{.frames = 50, .with_pose = 0, .used = 0, .waiting_for = "parallax"};
  EXPECT_THAT(warnings_of(evidence),
              ElementsAre(AllOf(HasSubstr("vio: never initialized"), HasSubstr("parallax"))));
  EXPECT_FALSE(vio_served(evidence));
  evidence.vio->with_pose = 50;
  EXPECT_THAT(warnings_of(evidence),
              ElementsAre(HasSubstr("vio: none of its 50 poses was accepted")));
  EXPECT_FALSE(vio_served(evidence));
}

TEST(InputWarnings, BlackImagesAreNotBlamedOnTheCalibration) {
  Evidence evidence = good_evidence();
  evidence.vio = VioService{.frames = 50, .waiting_for = "parallax"};
  for (int i = 0; i < 25; ++i) evidence.vio->add_image({.quality = vio::FrameQuality::featureless});
  for (int i = 0; i < 25; ++i) evidence.vio->add_image({});
  EXPECT_THAT(warnings_of(evidence), ElementsAre(HasSubstr("vio: never initialized")));
  evidence.vio->add_image({.quality = vio::FrameQuality::featureless, .brightness = 26.0});
  EXPECT_THAT(warnings_of(evidence),
              ElementsAre(HasSubstr("26 of 50 images are black (mean gray value 1 of 255)")));
  evidence.vio->uniform_gray = 26 * 128.0;
  EXPECT_THAT(warnings_of(evidence), ElementsAre(HasSubstr("images are uniform")));
}

TEST(InputWarnings, NameDvlAndPressureOfWhichNothingWasUsed) {
  Evidence evidence = good_evidence();
  evidence.acoustic->counts.pings = {{dipo::Verdict::rejected, 40}, {dipo::Verdict::no_lock, 2}};
  evidence.acoustic->counts.depths = {{dipo::Verdict::rejected, 9}};
  EXPECT_THAT(warnings_of(evidence),
              ElementsAre(HasSubstr("dvl: no ping was used (40 rejected"),
                          HasSubstr("pressure: no sample was used (9 rejected")));
  EXPECT_FALSE(dipo_served(evidence));
  evidence.acoustic->waiting_for = "a DVL ping with bottom lock";
  EXPECT_THAT(warnings_of(evidence),
              Contains(HasSubstr("dvl: at the end odometry was not initialized")));
}

TEST(ResultWarnings, APlausibleResultIsNotMentioned) {
  EXPECT_THAT(check_result(good_evidence(), straight(0.5)), IsEmpty());
  EXPECT_THAT(check_result(good_evidence(), straight(2.5)), IsEmpty());
}

TEST(ResultWarnings, NameASpeedBeyondTheDvlOrVehicles) {
  Evidence evidence = good_evidence();
  EXPECT_THAT(check_result(evidence, straight(4.0)), ElementsAre(HasSubstr("trajectory: up to 4")));
  evidence.samples = SampleStatistics();
  EXPECT_THAT(check_result(evidence, straight(4.0)), IsEmpty());
  EXPECT_THAT(check_result(evidence, straight(12.0)), ElementsAre(HasSubstr("vehicles")));
}

TEST(ResultWarnings, OneCorrectionOfThePoseIsNoSpeed) {
  Trajectory trajectory = straight(0.5);
  for (std::size_t i = 100; i < trajectory.size(); ++i) {
    trajectory.poses[i].T_world_body.translation.y() += 30.0;
  }
  EXPECT_THAT(check_result(good_evidence(), trajectory), IsEmpty());
}

TEST(ResultWarnings, NameLowAcceptanceOfTheDvl) {
  Evidence evidence = good_evidence();
  evidence.acoustic->counts.pings = {{dipo::Verdict::accepted, 24}, {dipo::Verdict::rejected, 117}};
  EXPECT_THAT(check_result(evidence, straight(0.5)),
              ElementsAre(HasSubstr("only 24 of 141 pings")));
  evidence.acoustic->counts.pings = {{dipo::Verdict::accepted, 24}, {dipo::Verdict::no_lock, 400}};
  EXPECT_THAT(check_result(evidence, straight(0.5)), ElementsAre(HasSubstr("had bottom lock")));
}

TEST(ResultWarnings, NameClocksOfDvlAndImuThatDiffer) {
  const auto warnings_of_delay = [](double delay_s) {
    Evidence evidence = good_evidence();
    evidence.samples = SampleStatistics();
    for (int i = 0; i <= 30; ++i) {
      const Stamp stamp{1'000'000'000LL * (100 + i)};
      evidence.samples.add(ImuSample{stamp, {0.1, 0.0, 0.0}, {0.0, 0.0, 9.8}});
      DvlSample ping;
      ping.stamp = stamp + Duration::from_seconds(delay_s);
      ping.velocity.x() = 0.5;
      ping.valid = true;
      evidence.samples.add(ping);
    }
    return check_result(evidence, straight(0.5));
  };
  EXPECT_THAT(warnings_of_delay(0.5), IsEmpty());
  EXPECT_THAT(warnings_of_delay(18.0),
              ElementsAre(HasSubstr("dvl: begins and ends 18.0 s after the IMU")));
  EXPECT_THAT(warnings_of_delay(-18.0), ElementsAre(HasSubstr("18.0 s before the IMU")));
}

// IMU and depth for 40 s; the camera for a part of it.
Evidence forty_seconds(double camera_from_s, double camera_to_s, int imu_gap_samples = 0) {
  Evidence evidence = good_evidence();
  evidence.samples = SampleStatistics(3.0);
  for (int i = 0; i <= 400; ++i) {
    const Stamp stamp{100'000'000LL * i};
    if (i <= 200 || i > 200 + imu_gap_samples) {
      evidence.samples.add(ImuSample{stamp, {0.0, 0.001 * (i % 7), 0.0}, {0.0, 0.0, 9.8}});
    }
    evidence.samples.add(PressureDepthSample{stamp, 5.0 + 0.01 * (i % 3)});
  }
  for (double t = camera_from_s; t <= camera_to_s; t += 0.1) {
    evidence.samples.add(ImageFrame{Stamp{} + Duration::from_seconds(t), 0, {}, {}});
  }
  return evidence;
}

TEST(ResultWarnings, NameSensorsThatServedForAPart) {
  EXPECT_THAT(check_result(forty_seconds(1.0, 39.0), straight(0.5)), IsEmpty());
  EXPECT_THAT(check_result(forty_seconds(1.0, 9.0), straight(0.5)),
              ElementsAre(HasSubstr("samples cover 8.0 of 40.0 s")));
  EXPECT_THAT(check_result(forty_seconds(1e6, 1e6 + 40.0), straight(0.5)),
              ElementsAre(HasSubstr("camera: none of its stamps lies within the time of the IMU")));
}

TEST(ResultWarnings, NameBothSpansOfClocksThatDiffer) {
  const auto equal = check_result(forty_seconds(1e6 + 5.0, 1e6 + 45.0), straight(0.5));
  EXPECT_THAT(equal, ElementsAre(AllOf(HasSubstr("camera: "), HasSubstr("1000005.000 to 1000045"),
                                       HasSubstr("0.000 to 40.000 s"),
                                       HasSubstr("dataset.clock_shift_s.camera=-1000005.000"))));
  const auto shorter = check_result(forty_seconds(1e6, 1e6 + 20.0), straight(0.5));
  EXPECT_THAT(shorter, ElementsAre(HasSubstr("find out by how much the clocks differ")));
}

TEST(ResultWarnings, NameSensorsThatBeginLate) {
  EXPECT_THAT(check_result(forty_seconds(1.9, 39.0), straight(0.5)), IsEmpty());
  EXPECT_THAT(
      check_result(forty_seconds(4.0, 39.0), straight(0.5)),
      ElementsAre("camera: begins 4.0 s after the recording: poses begin at 0.0 s, the first of "
                  "them without it"));
  EXPECT_THAT(check_result(forty_seconds(4.0, 39.0), Trajectory{}),
              ElementsAre(HasSubstr("there are no poses")));
}

TEST(ResultWarnings, NamePosesThatBeginLate) {
  Trajectory late = straight(0.5);
  for (StampedPose& pose : late.poses) pose.stamp = pose.stamp + Duration::from_seconds(12.0);
  EXPECT_THAT(check_result(forty_seconds(1.0, 39.0), late),
              ElementsAre(HasSubstr("trajectory: begins 12.0 s after the recording")));
}

TEST(InputWarnings, NameUnitsThatWereReplaced) {
  Evidence evidence = good_evidence();
  evidence.streams["dvl"].remark = "dvl0/data.csv: taken as [us]";
  EXPECT_THAT(warnings_of(evidence), ElementsAre("dvl0/data.csv: taken as [us]"));
}

TEST(ResultWarnings, NameGapsOfTheImuThatNoImagesBridge) {
  Evidence evidence = forty_seconds(1.0, 39.0, 9);
  EXPECT_THAT(check_result(evidence, straight(0.5)), IsEmpty());
  evidence.vio.reset();
  EXPECT_THAT(check_result(evidence, straight(0.5)),
              ElementsAre(HasSubstr("imu: no samples for 1.0 s after 20.00 s")));
}

TEST(ResultWarnings, NameSensorsThatRepeatOneValue) {
  Evidence evidence = good_evidence();
  evidence.samples = SampleStatistics();
  for (int i = 0; i < 100; ++i) {
    evidence.samples.add(ImuSample{Stamp{i}, {0.0, 0.0, 0.0}, {0.0, 0.0, 9.8}});
    evidence.samples.add(PressureSample{Stamp{i}, 150'000.0});
  }
  EXPECT_THAT(check_result(evidence, straight(0.5)),
              ElementsAre(HasSubstr("all angular rates are exactly zero"),
                          HasSubstr("all samples are exactly the same")));
}

TEST(ResultWarnings, NameADvlThatRepeatsOneValueFromTheStart) {
  Evidence evidence = good_evidence();
  evidence.acoustic->counts.pings = {{dipo::Verdict::repeated, 50}};
  EXPECT_THAT(check_result(evidence, straight(0.5)),
              ElementsAre(HasSubstr("dvl: 50 of 50 pings repeat the one before")));
}

TEST(ResultWarnings, NameTimesInWhichTheImuDoesNotChange) {
  Evidence evidence = good_evidence();
  evidence.samples = SampleStatistics();
  const auto add = [&](double t, double noise) {
    evidence.samples.add(ImuSample{
        Stamp{} + Duration::from_seconds(t), {0.1 + noise, 0.0, 0.0}, {0.0, 0.0, 9.8 + noise}});
  };
  for (int i = 0; i < 200; ++i) {
    const int measurement = i / 2;  // every value twice
    add(0.01 * i, 1e-4 * measurement);
  }
  EXPECT_THAT(check_result(evidence, straight(0.5)), IsEmpty());
  for (int i = 0; i < 500; ++i) add(2.0 + 0.01 * i, 0.0);
  EXPECT_THAT(check_result(evidence, straight(0.5)),
              ElementsAre(HasSubstr("its values do not change for 5.0 s after 2.00 s")));
}

TEST(ResultWarnings, NameDepthsThatAreHeights) {
  Evidence evidence = good_evidence();
  for (int i = 0; i < 200; ++i) {
    evidence.samples.add(PressureDepthSample{Stamp{i}, i % 2 == 0 ? -0.2 : -0.25});
  }
  EXPECT_THAT(check_result(evidence, straight(0.5)),
              ElementsAre(HasSubstr("depth: never below the surface (-0.20 m at most)")));
  for (int i = 0; i < 200; ++i) evidence.samples.add(PressureDepthSample{Stamp{i}, 0.2});
  EXPECT_THAT(check_result(evidence, straight(0.5)), IsEmpty());
}

TEST(ResultWarnings, NamePressuresThatContradictTheDvl) {
  Evidence evidence = good_evidence();
  evidence.acoustic->counts.depths = {{dipo::Verdict::accepted, 138},
                                      {dipo::Verdict::downweighted, 179},
                                      {dipo::Verdict::rejected, 24}};
  EXPECT_THAT(check_result(evidence, straight(0.5)),
              ElementsAre(HasSubstr("only 138 of 341 samples agree with DVL and IMU")));
  evidence.acoustic->counts.depths[dipo::Verdict::accepted] = 300;
  EXPECT_THAT(check_result(evidence, straight(0.5)), IsEmpty());
}

TEST(ResultWarnings, NameSpeedsThatOnlyPlaceholdersHave) {
  Evidence evidence = good_evidence();
  evidence.samples = SampleStatistics();
  DvlSample ping;
  ping.velocity.x() = 302.0;
  evidence.samples.add(ping);
  EXPECT_THAT(check_result(evidence, straight(0.5)), ElementsAre(HasSubstr("in mm/s or cm/s")));
}

TEST(ResultWarnings, NameADvlThatIsSlowerThanItsNoise) {
  Evidence evidence = good_evidence();
  evidence.samples = SampleStatistics();
  for (int i = 0; i < 100; ++i) {
    DvlSample ping;
    ping.velocity.x() = 0.5e-3;
    ping.valid = true;
    evidence.samples.add(ping);
  }
  EXPECT_THAT(check_result(evidence, straight(0.0004)),
              Contains(HasSubstr("less than the noise of a DVL")));
}

TEST(ResultWarnings, NamePingsThatRepeat) {
  Evidence evidence = good_evidence();
  evidence.acoustic->counts.pings[dipo::Verdict::repeated] = 15;
  EXPECT_THAT(check_result(evidence, straight(0.5)), IsEmpty());
  evidence.acoustic->counts.pings[dipo::Verdict::repeated] = 60;
  EXPECT_THAT(check_result(evidence, straight(0.5)),
              ElementsAre(HasSubstr("60 of 160 pings repeat")));
}

TEST(ResultWarnings, NameTheUnitsOfTheImu) {
  const auto warnings_of_imu = [](const Eigen::Vector3d& gyro, const Eigen::Vector3d& accel) {
    Evidence evidence = good_evidence();
    evidence.samples = SampleStatistics();
    evidence.samples.add(ImuSample{Stamp{1}, gyro, accel});
    return check_result(evidence, straight(0.5));
  };
  EXPECT_THAT(warnings_of_imu({0, 0, 0.1}, {0, 0, 9.5}), IsEmpty());
  EXPECT_THAT(warnings_of_imu({0, 0, 0.1}, {0, 0, 1.0}), ElementsAre(HasSubstr("in g")));
  EXPECT_THAT(warnings_of_imu({0, 0, 0.1}, {0, 0, 0.1}), ElementsAre(HasSubstr("gravity seems")));
  EXPECT_THAT(warnings_of_imu({0, 0, 5.0}, {0, 0, 9.8}), ElementsAre(HasSubstr("deg/s")));
}

// A dive whose depth sensor is unusable, with a camera whose images have the wrong size.
RunConfig troubled_dive(const test::TmpDir& tmp) {
  test::write_dive(tmp, "dive", {.duration_s = 20.0});
  tmp.write("dive/mav0/depth0/data.csv", "#timestamp [ns],depth [m]\n1,deep\n2,deep\n");
  std::ofstream(tmp.path() / "dive/rig.yaml", std::ios::app)
      << "cam0: {model: pinhole, intrinsics: [400, 400, 320, 240], resolution: [640, 480]}\n";
  std::string table = "#timestamp [ns],filename\n";
  std::ifstream truth(tmp.path() / "dive/mav0/state_groundtruth_estimate0/data.csv");
  std::string line;
  std::getline(truth, line);
  for (int i = 0; std::getline(truth, line); ++i) {
    if (i % 50 == 0) table += line.substr(0, line.find(',')) + ",small.png\n";
  }
  tmp.write("dive/mav0/cam0/data.csv", table);
  fs::create_directories(tmp.path() / "dive/mav0/cam0/data");
  cv::imwrite((tmp.path() / "dive/mav0/cam0/data/small.png").string(),
              cv::Mat(240, 320, CV_8UC1, cv::Scalar(90)));
  RunConfig config;
  config.dataset.path = (tmp.path() / "dive").string();
  return config;
}

TEST(RunWarnings, AreInMetricsAndVioWithoutAPoseHasNoFigures) {
  const test::TmpDir tmp;
  const RunResult result = run(troubled_dive(tmp), {.folder = tmp.path() / "run"});
  EXPECT_THAT(result.warnings, Contains(HasSubstr("depth: 2 of 2 samples were dropped")));
  EXPECT_THAT(result.warnings, Contains(AllOf(HasSubstr("cam0: "), HasSubstr("320 x 240"))));
  EXPECT_THAT(result.warnings, Contains(HasSubstr("vio: ")));
  const auto metrics = eval::read_metrics(tmp.path() / "run" / "metrics.json");
  EXPECT_EQ(metrics["warnings"].get<std::vector<std::string>>(), result.warnings);
  EXPECT_EQ(metrics["vio"], eval::Json({{"success", false}}));
  EXPECT_FALSE(metrics["trajectory"].contains("vio"));
  EXPECT_TRUE(metrics["trajectory"].contains("dipo"));
  EXPECT_GT(metrics["counts"]["images"]["cam0"]["wrong_size"].get<int>(), 30);
}

TEST(RunWarnings, AGoodDiveHasNone) {
  const test::TmpDir tmp;
  test::write_dive(tmp, "dive", {.duration_s = 20.0});
  RunConfig config;
  config.dataset.path = (tmp.path() / "dive").string();
  EXPECT_THAT(run(config, {.folder = tmp.path() / "run"}).warnings, IsEmpty());
}

}  // namespace
}  // namespace apvi::runs
