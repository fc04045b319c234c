// SPDX-License-Identifier: BSD-3-Clause
#include "live/session.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "apvi/core/error.hpp"
#include "core/stopwatch.hpp"
#include "live/loopback.hpp"
#include "live/pose_output.hpp"
#include "live/socket.hpp"
#include "live/sources.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::live {
namespace {

using test::eventually;
using test::TmpDir;

constexpr const char* kRig =
    "imu0: {}\ndvl0: {}\npressure0: {}\ncam0: {intrinsics: [10, 10, 4, 3], resolution: [8, 6]}\n";

// Two seconds of IMU at 100 Hz, DVL and pressure at 10 Hz, with numbers that need all digits.
void write_dive(const TmpDir& dir) {
  std::string imu = "#timestamp [ns],w_x,w_y,w_z,a_x [m s^-2],a_y [m s^-2],a_z [m s^-2]\n";
  std::string dvl = "#timestamp [ns],v_x,v_y,v_z,valid,beam0_v,beam0_range,beam0_valid\n";
  std::string pressure = "#timestamp [ns],pressure [Pa]\n";
  for (std::int64_t i = 0; i < 200; ++i) {
    const std::int64_t ns = 1'000'000'000'000 + i * 10'000'000;
    const double x = 0.1 / 3.0 + static_cast<double>(i) / 7.0;
    imu += fmt::format("{},{},{},{},{},{},9.81\n", ns, x, -x, 0.5 * x, 1e-3 * x, x);
    if (i % 10 != 0) continue;
    dvl += fmt::format("{},{},{},{},{},{},2.5,1\n", ns, x, -x, 0.1 * x, i % 20 == 0 ? 1 : 0, x);
    pressure += fmt::format("{},{}\n", ns, 101'325.0 + x);
  }
  dir.write("rig.yaml", "imu0: {}\ndvl0: {}\npressure0: {}\n");
  dir.write("mav0/imu0/data.csv", imu);
  dir.write("mav0/dvl0/data.csv", dvl);
  dir.write("mav0/pressure0/data.csv", pressure);
}

std::vector<SensorEvent> read_all(io::SequenceReader& reader) {
  std::vector<SensorEvent> events;
  while (auto event = reader.next()) events.push_back(std::move(*event));
  return events;
}

std::vector<SensorEvent> read_recording(const std::filesystem::path& path) {
  io::DatasetConfig config;
  config.path = path.string();
  return read_all(*io::open_sequence(config, {}));
}

std::vector<std::unique_ptr<Source>> playing(const TmpDir& dir) {
  std::vector<std::unique_ptr<Source>> sources;
  sources.push_back(make_source(dir.path().string()).source);
  return sources;
}

void expect_equal(const SensorEvent& a, const SensorEvent& b) {
  ASSERT_EQ(a.index(), b.index());
  EXPECT_EQ(stamp_of(a), stamp_of(b));
  if (const auto* imu = std::get_if<ImuSample>(&a)) {
    EXPECT_EQ(imu->gyro, std::get<ImuSample>(b).gyro);
    EXPECT_EQ(imu->accel, std::get<ImuSample>(b).accel);
  }
  if (const auto* ping = std::get_if<DvlSample>(&a)) {
    const auto& other = std::get<DvlSample>(b);
    EXPECT_EQ(ping->velocity, other.velocity);
    EXPECT_EQ(ping->valid, other.valid);
    ASSERT_TRUE(ping->beams[0] && other.beams[0]);
    EXPECT_EQ(ping->beams[0]->velocity, other.beams[0]->velocity);
    EXPECT_FALSE(other.beams[1]);
  }
  if (const auto* pressure = std::get_if<PressureSample>(&a)) {
    EXPECT_EQ(pressure->pressure_pa, std::get<PressureSample>(b).pressure_pa);
  }
}

TEST(Session, TheRecordingHoldsExactlyWhatTheReaderGot) {
  const TmpDir dive;
  const TmpDir out;
  write_dive(dive);
  const config::Node rig = make_source(dive.path().string()).rig;
  Recorder recorder(out.path() / "recording", rig);
  Session session(playing(dive), rig, {.recorder = &recorder});
  session.start([] { return false; });
  const std::vector<SensorEvent> live = read_all(session.sequence());
  session.stop();
  recorder.finish();
  EXPECT_GT(live.size(), 90U);  // those of the first second tell the clock
  const std::vector<SensorEvent> recorded = read_recording(out.path() / "recording");
  ASSERT_EQ(live.size(), recorded.size());
  for (std::size_t i = 0; i < live.size(); ++i) expect_equal(live[i], recorded[i]);
  EXPECT_TRUE(session.late().empty());
  EXPECT_EQ(session.sources().at(0).state, ConnectionState::ended);
}

TEST(Session, EndsAtOnceWhenInterrupted) {
  const TmpDir dive;
  write_dive(dive);
  Session session(playing(dive), config::parse_yaml(kRig, "rig"), {});
  std::atomic<bool> interrupted = false;
  session.start([&] { return interrupted.load(); });
  std::jthread signal([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    interrupted = true;
  });
  const Stopwatch watch;
  read_all(session.sequence());
  session.stop();
  EXPECT_LT(watch.seconds(), 1.5);  // of two seconds
}

void expect_read_back(const cv::Mat& image, ImageFormat format) {
  const TmpDir out;
  Recorder recorder(out.path(), config::parse_yaml(kRig, "rig"), format);
  recorder.push(ImageFrame{Stamp{5}, 0, [&] { return image; }});
  recorder.finish();
  const auto events = read_recording(out.path());
  ASSERT_EQ(events.size(), 1U);
  const cv::Mat read = std::get<ImageFrame>(events[0]).decode();
  ASSERT_EQ(read.type(), image.type());
  EXPECT_EQ(cv::norm(read, image, cv::NORM_INF), 0.0);
}

TEST(Recorder, ImagesAreReadBackExactly) {
  cv::Mat image(6, 8, CV_8UC3);
  for (int i = 0; i < 6 * 8 * 3; ++i) image.data[i] = static_cast<unsigned char>(7 * i);
  cv::Mat gray;
  cv::extractChannel(image, gray, 1);
  for (const ImageFormat format : {ImageFormat::png, ImageFormat::pnm}) {
    expect_read_back(image, format);
    expect_read_back(gray, format);
  }
}

TEST(Recorder, AFailureStopsTheRecordingOnly) {
  const TmpDir out;
  Recorder recorder(out.path(), config::parse_yaml(kRig, "rig"));
  recorder.push(ImageFrame{Stamp{5}, 0, []() -> cv::Mat { fail_run("disk full"); }});
  EXPECT_TRUE(eventually([&] { return recorder.failed(); }));
  recorder.push(ImuSample{});
  recorder.finish();
}

PoseOutput pose_at(std::int64_t ns, bool trusted) {
  PoseOutput pose;
  pose.stamp = Stamp{ns};
  pose.trusted = trusted;
  return pose;
}

TEST(PoseOutputs, SendTrustedPosesOnlyAndAtTheGivenRate) {
  Socket receiver = Socket::bind_udp({"127.0.0.1", 0});
  PoseOutputs outputs({fmt::format("udp://127.0.0.1:{}", receiver.port())}, 10.0, true);
  for (std::int64_t i = 0; i < 20; ++i) {
    outputs.write(pose_at(i * 20'000'000, i != 0));
  }
  std::vector<std::string> lines;
  std::array<std::uint8_t, 2048> buffer;
  while (receiver.wait(std::chrono::milliseconds(50))) {
    const std::size_t size = receiver.read(buffer);
    lines.emplace_back(reinterpret_cast<const char*>(buffer.data()), size);
  }
  ASSERT_EQ(lines.size(), 4U);
  EXPECT_NE(lines[0].find("\"stamp_ns\":20000000"), std::string::npos) << lines[0];
  EXPECT_NE(lines[0].find("\"reset_counter\":0"), std::string::npos) << lines[0];
}

TEST(PoseOutputs, WriteTumLinesIntoAFile) {
  const TmpDir dir;
  const std::filesystem::path file = dir.path() / "poses.tum";
  {
    PoseOutputs outputs({"tum:" + file.string()}, 0.0, true);
    outputs.write(pose_at(1'500'000'000, true));
  }
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  EXPECT_EQ(line.substr(0, 11), "1.500000000");
  EXPECT_THROW(PoseOutputs({"tum:"}, 0.0, true), InputError);
  EXPECT_THROW(PoseOutputs({"udp://here"}, 0.0, true), InputError);
}

}  // namespace
}  // namespace apvi::live
