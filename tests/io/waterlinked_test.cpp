// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/waterlinked_log.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>

#include "io/dataset_builder.hpp"

namespace apvi {
namespace {

using io::DropReason;
using test::config_for;
using test::read_dataset;
using test::TmpDir;
using testing::HasSubstr;

// A report as the device sends it, with three good beams.
std::string report(std::int64_t us, const std::string& flags = R"("velocity_valid":true)",
                   const std::string& type = "velocity") {
  return R"({"time":106.39,"vx":0.25,"vy":-0.5,"vz":0.125,"fom":0.0016,)"
         R"("covariance":[[1e-8,0,0],[0,1e-8,0],[0,0,1e-8]],"altitude":0.75,"transducers":[)"
         R"({"id":0,"velocity":0.1,"distance":0.8,"rssi":-30.5,"nsd":-88.7,"beam_valid":true},)"
         R"({"id":1,"velocity":-0.2,"distance":0.9,"rssi":-31.1,"nsd":-89.5,"beam_valid":true},)"
         R"({"id":3,"velocity":0.3,"distance":1.0,"rssi":-28.0,"nsd":-88.3,"beam_valid":true},)"
         R"({"id":2,"velocity":0,"distance":-1,"rssi":-27.2,"nsd":-97.0,"beam_valid":false}],)" +
         flags + R"(,"status":0,"format":"json_v3.1","type":")" + type +
         fmt::format(R"(","time_of_validity":{},"time_of_transmission":{}}})", us, us + 190'000) +
         "\r\n";
}

std::vector<DvlSample> samples_in(const std::string& log) {
  const auto source = io::waterlinked_dvl(std::make_unique<std::istringstream>(log), "dvl.log");
  std::vector<DvlSample> samples;
  SensorEvent event;
  for (auto state = source->next(event); state != io::SourceState::end;
       state = source->next(event)) {
    if (state == io::SourceState::sample) samples.push_back(std::get<DvlSample>(event));
  }
  EXPECT_EQ(source->fraction(), 1.0);
  return samples;
}

TEST(WaterLinkedLog, GivesTheSamplesOfItsVelocityReports) {
  const auto samples = samples_in(report(1'638'191'471'563'017));
  ASSERT_EQ(samples.size(), 1U);
  const DvlSample& sample = samples[0];
  EXPECT_EQ(sample.stamp.ns, 1'638'191'471'563'017'000);
  EXPECT_EQ(sample.velocity, Eigen::Vector3d(0.25, -0.5, 0.125));
  EXPECT_TRUE(sample.valid);
  EXPECT_EQ(sample.figure_of_merit, 0.0016);
  EXPECT_EQ(sample.altitude, 0.75);
  ASSERT_TRUE(sample.beams[1] && sample.beams[2] && sample.beams[3]);
  EXPECT_EQ(sample.beams[1]->velocity, -0.2);
  EXPECT_EQ(sample.beams[1]->range, 0.9);
  EXPECT_TRUE(sample.beams[1]->valid);
  EXPECT_FALSE(sample.beams[2]->valid);
  EXPECT_FALSE(sample.beams[2]->range);
  EXPECT_EQ(sample.beams[3]->velocity, 0.3);
}

TEST(WaterLinkedLog, SkipsOtherReportsAndTextAroundThem) {
  const std::string position =
      R"({"ts":49056.809,"x":12.4,"y":64.6,"z":1.7,"std":0.002,"roll":0.6,"pitch":0.7,"yaw":90.1,)"
      R"("type":"position_local","status":0,"format":"json_v3.1"})";
  const std::string response = R"({"response_to":"get_config","success":true,"type":"response"})";
  EXPECT_EQ(samples_in("[\n" + position + ",\n2026-01-02 10:00:00,123 INFO " + report(5) +
                       response + "\n\n]\n" + report(6))
                .size(),
            2U);
}

TEST(WaterLinkedLog, ReportsWithoutBottomLockAreInvalidSamples) {
  const auto samples = samples_in(
      report(5, R"("velocity_valid":false)") +
      report(6, R"("velocity_valid":true)", "velocity_water") +
      report(7, R"("velocity_valid":true,"tracking_mode":"water")") +
      report(8, R"("velocity_valid":true,"tracking_mode":"bottom")") +
      R"({"velocity_valid":false,"altitude":-1,"type":"velocity","time_of_validity":9})");
  ASSERT_EQ(samples.size(), 5U);
  for (const std::size_t i : {0U, 1U, 2U, 4U}) EXPECT_FALSE(samples[i].valid) << i;
  EXPECT_TRUE(samples[3].valid);
  EXPECT_FALSE(samples[4].altitude);
}

TEST(WaterLinkedLog, IsReadWhereThereIsNoCsv) {
  for (const char* name : {"data.jsonl", "data.json", "data.log"}) {
    const TmpDir dir;
    dir.write("rig.yaml", "dvl0: {velocity_noise: 0.01}\n");
    dir.write(std::string("mav0/dvl0/") + name, report(1'000'000) + report(1'200'000));
    EXPECT_EQ(read_dataset(config_for(dir.path())).delivered("dvl"), 2U) << name;
    dir.write("mav0/dvl0/data.csv", "#timestamp [ns],v_x,v_y,v_z\n1,1,2,3\n");
    EXPECT_EQ(read_dataset(config_for(dir.path())).delivered("dvl"), 1U) << name;
  }
}

TEST(WaterLinkedLog, BrokenReportsAreDroppedWithTheirReason) {
  const TmpDir dir;
  dir.write("mav0/dvl0/data.jsonl",
            report(1'000'000) + R"({"vx":0.1,"vy":0.2,)" + "\n" +
                R"({"vx":1,"vy":2,"vz":3,"velocity_valid":true,"type":"velocity"})" + "\n" +
                R"({"vx":1,"vy":2,"velocity_valid":true,"type":"velocity","time_of_validity":5})" +
                "\n7\n" + report(1'200'000));
  testing::internal::CaptureStderr();
  const auto out = read_dataset(config_for(dir.path()));
  EXPECT_THAT(testing::internal::GetCapturedStderr(),
              testing::AllOf(HasSubstr("data.jsonl:2"), HasSubstr("no report in JSON"),
                             HasSubstr("no time_of_validity"), HasSubstr("no vx, vy, vz")));
  EXPECT_EQ(out.delivered("dvl"), 2U);
  EXPECT_EQ(out.dropped("dvl", DropReason::malformed), 4U);
}

}  // namespace
}  // namespace apvi
