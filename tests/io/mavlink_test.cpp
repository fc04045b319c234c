// SPDX-License-Identifier: BSD-3-Clause
#include "io/mavlink/messages.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "apvi/core/constants.hpp"
#include "core/random.hpp"

namespace apvi::io::mavlink {
namespace {

using Eigen::Vector3d;

// Frames as pymavlink 2.4 writes them, with the values of its `*_encode` call.
// raw_imu(123456789, 100,-200,-1000, 10,-20,30, 1,2,3, 0,2500), version 2 and 1
constexpr const char* kRawImu2 =
    "fd1d00000001011b000015cd5b0700000000640038ff18fc0a00ecff1e0001000200030000c4094e93";
constexpr const char* kRawImu1 =
    "fe1a0001011b15cd5b0700000000640038ff18fc0a00ecff1e000100020003002bc9";
// highres_imu(5000001, 0.5,-0.25,-9.75, 0.125,-0.5,0.0625, ..., fields_updated=0x3f or 0x38)
constexpr const char* kHighres =
    "fd3d0000000101690000414b4c00000000000000003f000080be00001cc10000003e000000bf0000803d0000000000"
    "0000000000000000507d4400000000000000000000a0413f3959";
constexpr const char* kHighresPart =
    "fd3d0000000101690000414b4c00000000000000003f000080be00001cc10000003e000000bf0000803d0000000000"
    "0000000000000000507d4400000000000000000000a041383114";
// scaled_imu{,2,3}(4321, 1,2,3, 4,5,6, 7,8,9, 0); the last one signed
constexpr const char* kScaledImu =
    "fd1500000001011a0000e110000001000200030004000500060007000800092d81";
constexpr const char* kScaledImu2 =
    "fd150000000101740000e1100000010002000300040005000600070008000966a0";
constexpr const char* kScaledImu3 =
    "fd150000000101810000e110000001000200030004000500060007000800094606";
constexpr const char* kSigned =
    "fd150100000101740000e11000000100020003000400050006000700080009958001050000000000547e04f3c5c3";
// scaled_pressure{2,,3}(1500, 1513.5 or 1013.25, ...), the second one version 1
constexpr const char* kPressure2 = "fd0e0000000101890000dc0500000030bd4400000000d2045f18";
constexpr const char* kPressure1 = "fe0e0001011ddc05000000507d4400000000d204d346";
constexpr const char* kPressure3 = "fd0e00000001018f0000dc05000000507d4400000000d2045187";
// system_time(1700000000123456, 654321), timesync(987654321000, 1700000000000000001)
constexpr const char* kSystemTime = "fd0b000000010102000040222018240a0600f1fb09111c";
constexpr const char* kTimeSync = "fd1000000001016f000068f3c8f4e500000001002a36fe9c97171749";
// heartbeat(12, 3, 81, 19, 4, 3): a submarine with ArduPilot; attitude(...), which is not read
constexpr const char* kHeartbeat = "fd090000000101000000130000000c035104037e81";
constexpr const char* kAttitude =
    "fd1c00000001011e0000dc050000cdcccc3dcdcc4c3e9a99993ecdcccc3e0000003f9a99193f3d1d";

using Bytes = std::vector<std::uint8_t>;

Bytes bytes_of(const std::string& hex) {
  Bytes bytes;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2) {
    bytes.push_back(static_cast<std::uint8_t>(std::stoul(hex.substr(i, 2), nullptr, 16)));
  }
  return bytes;
}

std::vector<Frame> frames_in(const Bytes& bytes, std::size_t* damaged = nullptr) {
  std::vector<Frame> frames;
  const std::size_t count = decode(bytes, [&](const Frame& frame) { frames.push_back(frame); });
  if (damaged != nullptr) *damaged = count;
  return frames;
}

template <typename M>
M message_in(const char* hex) {
  const std::vector<Frame> frames = frames_in(bytes_of(hex));
  EXPECT_EQ(frames.size(), 1U) << hex;
  const auto message = frames.empty() ? std::nullopt : interpret(frames[0]);
  const bool is_there = message && std::holds_alternative<M>(*message);
  EXPECT_TRUE(is_there) << hex;
  return is_there ? std::get<M>(*message) : M{};
}

TEST(Mavlink, ReadsInertialDataInBothVersions) {
  for (const char* hex : {kRawImu2, kRawImu1}) {
    const Imu imu = message_in<Imu>(hex);
    EXPECT_EQ(imu.id, Id::raw_imu);
    EXPECT_EQ(imu.time.stamp.ns, 123'456'789'000);
    EXPECT_EQ(imu.time.clock, Clock::boot);
    EXPECT_TRUE(imu.accel.isApprox(kStandardGravity * Vector3d(0.1, -0.2, -1.0), 1e-12));
    EXPECT_TRUE(imu.gyro.isApprox(Vector3d(0.01, -0.02, 0.03), 1e-12));
  }
  const Imu highres = message_in<Imu>(kHighres);
  EXPECT_EQ(highres.time.stamp.ns, 5'000'001'000);
  EXPECT_EQ(highres.accel, Vector3d(0.5, -0.25, -9.75));
  EXPECT_EQ(highres.gyro, Vector3d(0.125, -0.5, 0.0625));
}

TEST(Mavlink, ReadsTheInertialDataOfEachSensor) {
  const std::pair<const char*, Id> frames[] = {{kScaledImu, Id::scaled_imu},
                                               {kScaledImu2, Id::scaled_imu2},
                                               {kScaledImu3, Id::scaled_imu3},
                                               {kSigned, Id::scaled_imu2}};
  for (const auto& [hex, id] : frames) {
    const Imu imu = message_in<Imu>(hex);
    EXPECT_EQ(imu.id, id);
    EXPECT_EQ(imu.time.stamp.ns, 4'321'000'000);
    EXPECT_TRUE(imu.accel.isApprox(1e-3 * kStandardGravity * Vector3d(1, 2, 3), 1e-12));
    EXPECT_TRUE(imu.gyro.isApprox(Vector3d(0.004, 0.005, 0.006), 1e-12));
  }
}

TEST(Mavlink, ReadsPressureInPascal) {
  EXPECT_EQ(message_in<Pressure>(kPressure2).pressure_pa, 151'350.0);
  EXPECT_EQ(message_in<Pressure>(kPressure1).pressure_pa, 101'325.0);
  EXPECT_EQ(message_in<Pressure>(kPressure3).id, Id::scaled_pressure3);
  EXPECT_EQ(message_in<Pressure>(kPressure3).time.stamp.ns, 1'500'000'000);
}

TEST(Mavlink, ReadsTimes) {
  const SystemTime time = message_in<SystemTime>(kSystemTime);
  EXPECT_EQ(time.boot.ns, 654'321'000'000);
  ASSERT_TRUE(time.unix_time);
  EXPECT_EQ(time.unix_time->ns, 1'700'000'000'123'456'000);
  const TimeSync sync = message_in<TimeSync>(kTimeSync);
  EXPECT_EQ(sync.remote.ns, 987'654'321'000);
  EXPECT_EQ(sync.local.ns, 1'700'000'000'000'000'001);
  EXPECT_EQ(message_in<Heartbeat>(kHeartbeat).autopilot, 3);
}

TEST(Mavlink, ReadingsThatWereNotUpdatedAreNoSample) {
  const std::vector<Frame> frames = frames_in(bytes_of(kHighresPart));
  ASSERT_EQ(frames.size(), 1U);
  EXPECT_FALSE(interpret(frames[0]));
}

TEST(Mavlink, FindsFramesAmongOtherBytes) {
  Bytes bytes = bytes_of("00fd13fe42");
  for (const char* hex : {kAttitude, kPressure1, kScaledImu2}) {
    const Bytes frame = bytes_of(hex);
    bytes.insert(bytes.end(), frame.begin(), frame.end());
  }
  EXPECT_EQ(frames_in(bytes).size(), 2U);
}

TEST(Mavlink, AWrongChecksumIsCountedAndTheNextFrameIsRead) {
  Bytes bytes = bytes_of(kScaledImu2);
  bytes[14] ^= 1;
  const Bytes good = bytes_of(kPressure2);
  bytes.insert(bytes.end(), good.begin(), good.end());
  std::size_t damaged = 0;
  const std::vector<Frame> frames = frames_in(bytes, &damaged);
  ASSERT_EQ(frames.size(), 1U);
  EXPECT_EQ(frames[0].id, Id::scaled_pressure2);
  EXPECT_EQ(damaged, 1U);
}

TEST(Mavlink, WritesWhatItReads) {
  Frame frame = frames_in(bytes_of(kSystemTime)).at(0);
  EXPECT_EQ(encode(frame, 0), bytes_of(kSystemTime));
  frame = frames_in(bytes_of(kRawImu1)).at(0);
  EXPECT_EQ(frames_in(encode(frame, 7)).at(0).payload, frame.payload);
}

TEST(Mavlink, RandomBytesNeverCrash) {
  Random random(3);
  for (int i = 0; i < 20'000; ++i) {
    Bytes bytes(random.next() % 64);
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random.next());
    if (!bytes.empty()) bytes[0] = i % 2 == 0 ? 0xFD : 0xFE;
    for (const Frame& frame : frames_in(bytes)) interpret(frame);
  }
}

}  // namespace
}  // namespace apvi::io::mavlink
