// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "core/random.hpp"
#include "io/cdr_bytes.hpp"
#include "io/dataset_builder.hpp"
#include "io/db3_writer.hpp"
#include "io/mcap_writer.hpp"
#include "io/ros_bytes.hpp"
#include "io/rosbag/ros_message.hpp"
#include "io/rosbag2/ros2_definitions.hpp"

namespace apvi {
namespace {

using test::config_for;
using test::Db3Writer;
using test::input_error;
using test::McapWriter;
using test::read_dataset;
using test::TmpDir;
using testing::AllOf;
using testing::HasSubstr;

constexpr std::int64_t kBegin = 1'000'000'000'000;

std::int64_t at(double seconds) {
  return kBegin + Duration::from_seconds(seconds).ns;
}

std::vector<std::uint8_t> png(int value) {
  std::vector<std::uint8_t> file;
  cv::imencode(".png", cv::Mat(4, 6, CV_8UC1, cv::Scalar(value)), file);
  return file;
}

struct Message {
  std::string topic;
  std::string type;
  std::int64_t ns = 0;
  std::vector<std::uint8_t> bytes;
};

// Three seconds of all sensors, in order of time.
std::vector<Message> recording() {
  std::vector<Message> all;
  for (int i = 0; i < 300; ++i) {
    const std::int64_t ns = at(0.01 * i);
    all.push_back({"/imu/data", "sensor_msgs/msg/Imu", ns, test::cdr_imu(ns, 0.001 * i)});
    if (i % 20 == 0) all.push_back({"/dvl/data", "dvl_msgs/msg/DVL", ns, test::cdr_dvl(ns, 0.5)});
    if (i % 10 == 0) {
      all.push_back(
          {"/depth/data", "nav_msgs/msg/Odometry", ns, test::cdr_odometry(ns, 0.0, -1.5)});
      all.push_back(
          {"/mocap/pose", "nav_msgs/msg/Odometry", ns, test::cdr_odometry(ns, 0.01 * i, 0.0)});
      all.push_back({"/camera/image_raw/compressed", "sensor_msgs/msg/CompressedImage", ns,
                     test::cdr_image(ns, png(i / 10))});
    }
  }
  return all;
}

std::string mcap_of(const std::vector<Message>& messages, const McapWriter::Options& options,
                    std::size_t chunk = 50) {
  McapWriter writer(options);
  std::map<std::string, std::uint16_t> ids;
  std::size_t count = 0;
  for (const Message& m : messages) {
    if (!ids.contains(m.topic)) {
      const auto definition = io::ros2_definitions(io::ros_type_name(m.type)).at(0);
      ids[m.topic] = writer.add_topic(m.topic, m.type, definition);
    }
    writer.write(ids.at(m.topic), m.ns, m.bytes);
    if (++count % chunk == 0) writer.end_chunk();
  }
  return writer.finish();
}

void write_db3(const std::filesystem::path& path, const std::vector<Message>& messages,
               bool with_definitions = false) {
  Db3Writer writer(path);
  std::map<std::string, int> ids;
  for (const Message& m : messages) {
    if (!ids.contains(m.topic)) {
      const auto definition = io::ros2_definitions(io::ros_type_name(m.type)).at(0);
      ids[m.topic] = writer.add_topic(m.topic, m.type, with_definitions ? definition : "");
    }
    writer.write(ids.at(m.topic), m.ns, m.bytes);
  }
  writer.close();
}

void expect_recording(const std::filesystem::path& path) {
  const auto out = read_dataset(config_for(path));
  EXPECT_EQ(out.delivered("imu"), 300U);
  EXPECT_EQ(out.delivered("dvl"), 15U);
  EXPECT_EQ(out.delivered("depth"), 30U);
  EXPECT_EQ(out.delivered("camera"), 30U);
  for (const char* kind : {"imu", "dvl", "depth", "camera"}) EXPECT_EQ(out.dropped(kind), 0U);
  const auto in_order = [](const auto& a, const auto& b) { return stamp_of(a) < stamp_of(b); };
  EXPECT_TRUE(std::is_sorted(out.events.begin(), out.events.end(), in_order));
  const auto reference = io::open_sequence(config_for(path), {})->reference();
  ASSERT_TRUE(reference);
  EXPECT_NEAR(reference->path_length(), 2.9, 1e-9);
}

std::size_t imu_of(const std::filesystem::path& path) {
  return read_dataset(config_for(path), {"imu"}).delivered("imu");
}

TEST(Mcap, ReadsEveryCompressionAndStructure) {
  const TmpDir dir;
  for (const char* compression : {"", "lz4", "zstd"}) {
    for (const bool chunks : {true, false}) {
      for (const bool summary : {true, false}) {
        SCOPED_TRACE(fmt::format("\"{}\" {} {}", compression, chunks, summary));
        expect_recording(
            dir.write("a.mcap", mcap_of(recording(), {compression, chunks, summary, !summary})));
      }
    }
  }
}

TEST(Mcap, RoundTripsSamples) {
  const TmpDir dir;
  const auto out = read_dataset(config_for(dir.write("a.mcap", mcap_of(recording(), {}))));
  const auto find = [&](std::size_t type, std::size_t nth) {
    for (const auto& event : out.events) {
      if (event.index() == type && nth-- == 0) return event;
    }
    throw std::runtime_error("no such event");
  };
  const auto imu = std::get<ImuSample>(find(SensorEvent(ImuSample{}).index(), 7));
  EXPECT_EQ(imu.stamp.ns, at(0.07));
  EXPECT_DOUBLE_EQ(imu.gyro.x(), 0.007);
  EXPECT_EQ(imu.accel, Eigen::Vector3d(1, 2, 9.8));
  const auto dvl = std::get<DvlSample>(find(SensorEvent(DvlSample{}).index(), 1));
  EXPECT_TRUE(dvl.valid);
  EXPECT_EQ(dvl.velocity, Eigen::Vector3d(0.5, -0.25, 0.125));
  EXPECT_DOUBLE_EQ(dvl.altitude.value(), 2.5);
  EXPECT_DOUBLE_EQ(dvl.beams[2]->range.value(), 3.5);
  const auto image = std::get<ImageFrame>(find(SensorEvent(ImageFrame{}).index(), 12));
  EXPECT_EQ(image.decode().at<std::uint8_t>(2, 3), 12);
}

TEST(Mcap, MergesOverlappingChunksInOrderOfTime) {
  const TmpDir dir;
  for (const bool summary : {true, false}) {
    McapWriter writer({.compression = "lz4", .summary = summary});
    const auto id = writer.add_topic("/imu", "sensor_msgs/msg/Imu",
                                     io::ros2_definitions("sensor_msgs/Imu").at(0));
    // Chunk k has the samples k, k + 20, k + 40, ...: all chunks overlap.
    for (int k = 19; k >= 0; --k) {
      for (int i = k; i < 400; i += 20)
        writer.write(id, at(0.1 * i), test::cdr_imu(at(0.1 * i), i));
      writer.end_chunk();
    }
    const auto out = read_dataset(config_for(dir.write("a.mcap", writer.finish())));
    EXPECT_EQ(out.delivered("imu"), 400U) << summary;
    EXPECT_EQ(out.dropped("imu"), 0U) << summary;
  }
}

TEST(Mcap, DropsNothingButTheEndOfATruncatedFile) {
  const TmpDir dir;
  for (const char* compression : {"", "lz4", "zstd"}) {
    for (const bool chunks : {true, false}) {
      const std::string whole = mcap_of(recording(), {compression, chunks, false, true}, 20);
      std::size_t last = 0;
      for (const double fraction : {0.2, 0.4, 0.6, 0.8}) {
        const auto size = static_cast<std::size_t>(fraction * static_cast<double>(whole.size()));
        testing::internal::CaptureStderr();
        const std::size_t count = imu_of(dir.write("cut.mcap", whole.substr(0, size)));
        const std::string text = testing::internal::GetCapturedStderr();
        EXPECT_GT(count, last) << compression << chunks << fraction;
        EXPECT_GT(static_cast<double>(count), 300.0 * (fraction - 0.15)) << compression << chunks;
        EXPECT_LT(count, 300U);
        EXPECT_EQ(text.find("damaged at byte"), text.rfind("damaged at byte")) << text;
        EXPECT_THAT(text, HasSubstr("damaged at byte"));
        last = count;
      }
    }
  }
}

TEST(Mcap, WrongChecksumEndsReading) {
  const TmpDir dir;
  std::string damaged = mcap_of(recording(), {}, 50);
  damaged[damaged.size() / 2] ^= 1;
  const std::size_t count = imu_of(dir.write("a.mcap", damaged));
  EXPECT_GT(count, 100U);
  EXPECT_LT(count, 170U);
}

TEST(Mcap, DoesNotCrashOnRandomDamage) {
  const TmpDir dir;
  Random random(5);
  for (const char* compression : {"", "lz4", "zstd"}) {
    const std::string whole = mcap_of(recording(), {compression, true, true, false});
    for (int round = 0; round < 100; ++round) {
      std::string damaged = whole;
      for (int i = 0; i < 3; ++i) {
        const double place = i == 0 ? random.uniform() : random.uniform(0.9, 1.0);  // the index
        damaged[static_cast<std::size_t>(place * static_cast<double>(whole.size()))] =
            static_cast<char>(random.next());
      }
      const auto path = dir.write("damaged.mcap", damaged);
      input_error([&] { EXPECT_LE(read_dataset(config_for(path)).events.size(), 375U); });
    }
  }
}

TEST(Mcap, HugeSizesAreNotAllocated) {
  const TmpDir dir;
  const std::string whole = mcap_of(recording(), {.summary = false}, 1000);
  const std::size_t chunk = whole.find("ros2") + 4 + 8;            // after the header
  for (const std::size_t field : {1UL, 9UL + 16UL, 9UL + 32UL}) {  // record, uncompressed, stored
    std::string damaged = whole;
    for (std::size_t i = 0; i < 7; ++i) damaged[chunk + field + i] = '\xff';
    const auto path = dir.write("huge.mcap", damaged);
    input_error([&] { EXPECT_LE(read_dataset(config_for(path)).events.size(), 375U); });
  }
}

TEST(Mcap, ErrorNamesTopicAndEncodingThatCannotBeRead) {
  const TmpDir dir;
  McapWriter writer;
  writer.write(writer.add_topic("/imu", "foxglove.Imu", "binary", "protobuf", "protobuf"), at(0),
               {1, 2, 3});
  auto config = config_for(dir.write("a.mcap", writer.finish()));
  EXPECT_THAT(
      input_error([&] { read_dataset(config); }),
      AllOf(HasSubstr("a.mcap: no readable topics"), HasSubstr("/imu"), HasSubstr("\"protobuf\"")));

  McapWriter both;
  both.write(both.add_topic("/imu", "foxglove.Imu", "binary", "protobuf", "protobuf"), at(0), {1});
  both.write(
      both.add_topic("/imu2", "sensor_msgs/msg/Imu", io::ros2_definitions("sensor_msgs/Imu").at(0)),
      at(0), test::cdr_imu(at(0), 1.0));
  config = config_for(dir.write("b.mcap", both.finish()));
  EXPECT_EQ(read_dataset(config).delivered("imu"), 1U);
  config.topics.imu = "/imu";
  EXPECT_THAT(input_error([&] { read_dataset(config); }),
              AllOf(HasSubstr("cannot read topic /imu"), HasSubstr("\"protobuf\"")));
}

TEST(Mcap, MalformedMessagesAreReportedWithTheirReason) {
  const TmpDir dir;
  McapWriter writer;
  const auto image = writer.add_topic("/camera/image_raw", "sensor_msgs/msg/Image",
                                      io::ros2_definitions("sensor_msgs/Image").at(0));
  const auto imu = writer.add_topic("/imu", "sensor_msgs/msg/Imu",
                                    io::ros2_definitions("sensor_msgs/Imu").at(0));
  test::CdrBytes bytes;
  bytes.header(at(0)).put(std::uint32_t{4}).put(std::uint32_t{6}).text("mono8");
  bytes.put(std::uint8_t{0}).put(std::uint32_t{6}).block(std::vector<std::uint8_t>(20));
  writer.write(image, at(0), bytes.get());
  writer.write(imu, at(0), {0, 1, 0, 0, 7});
  const auto path = dir.write("a.mcap", writer.finish());
  testing::internal::CaptureStderr();
  const auto out = read_dataset(config_for(path));
  const std::string log = testing::internal::GetCapturedStderr();
  EXPECT_EQ(out.dropped("camera", io::DropReason::malformed), 1U);
  EXPECT_THAT(log, HasSubstr("the image has another size than its data: \"6 x 4 mono8, step 6, 20 "
                             "bytes\""));
  EXPECT_THAT(log, HasSubstr("the bytes do not fit the definition of the message"));
}

TEST(Mcap, ReadsRos1Messages) {
  const TmpDir dir;
  McapWriter writer;
  const auto id = writer.add_topic(
      "/pressure", "sensor_msgs/FluidPressure",
      "Header header\nfloat64 fluid_pressure\nfloat64 variance\n" + test::kHeaderPart, "ros1",
      "ros1msg");
  test::RosBytes bytes;
  bytes.header(1000, 0).put(123456.0).put(0.0);
  writer.write(id, at(0), bytes.get());
  const auto out = read_dataset(config_for(dir.write("a.mcap", writer.finish())));
  EXPECT_DOUBLE_EQ(std::get<PressureSample>(out.events.at(0)).pressure_pa, 123456.0);
}

TEST(Mcap, OtherFilesAreRefused) {
  const TmpDir dir;
  EXPECT_THAT(input_error([&] { read_dataset(config_for(dir.write("a.mcap", ""))); }),
              HasSubstr("a.mcap: not a recording, but an empty file"));
  for (const char* content : {"\x89MCAP", "this is no bag, whatever its name says"}) {
    EXPECT_THAT(input_error([&] { read_dataset(config_for(dir.write("a.mcap", content))); }),
                HasSubstr("a.mcap: this is no MCAP file"));
  }
}

TEST(Mcap, MemoryDoesNotGrowWithTheRecording) {
  const TmpDir dir;
  McapWriter writer({.compression = "zstd"});
  const auto id = writer.add_topic("/camera", "sensor_msgs/msg/CompressedImage",
                                   io::ros2_definitions("sensor_msgs/CompressedImage").at(0));
  const std::vector<std::uint8_t> image(1U << 20U, 7);  // 400 MiB uncompressed
  for (int i = 0; i < 400; ++i) {
    writer.write(id, at(0.5 * i), test::cdr_image(at(0.5 * i), image));
    if (i % 4 == 3) writer.end_chunk();
  }
  const auto path = dir.write("a.mcap", writer.finish());
  const auto resident = [] {
    std::size_t total = 0;
    std::size_t pages = 0;
    std::ifstream("/proc/self/statm") >> total >> pages;
    return pages * 4096;
  };
  const auto reader = io::open_sequence(config_for(path), {});
  const std::size_t before = resident();
  std::size_t most = 0;
  while (reader->next()) most = std::max(most, resident());
  EXPECT_LT(most, before + (100U << 20U));
}

TEST(Db3, ReadsBagsWithAndWithoutDefinitions) {
  const TmpDir dir;
  write_db3(dir.path() / "a.db3", recording(), false);
  expect_recording(dir.path() / "a.db3");
  write_db3(dir.path() / "b.db3", recording(), true);
  expect_recording(dir.path() / "b.db3");
}

TEST(Db3, OwnDefinitionReplacesTheKnownOne) {
  const TmpDir dir;
  Db3Writer writer(dir.path() / "a.db3");
  const int id = writer.add_topic("/dvl", "other_msgs/msg/DVL",
                                  "geometry_msgs/Vector3 velocity\n" + test::kVectorPart);
  const int unknown = writer.add_topic("/status", "other_msgs/msg/Status");
  writer.write(unknown, at(0), {0, 1, 0, 0});
  writer.write(id, at(1), test::CdrBytes().put(1.0).put(2.0).put(3.0).get());
  writer.close();
  auto config = config_for(dir.path() / "a.db3");
  const auto out = read_dataset(config);
  EXPECT_EQ(std::get<DvlSample>(out.events.at(0)).velocity, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(stamp_of(out.events.at(0)).ns, at(1));  // no header: the time of recording
  config.topics.imu = "/status";
  EXPECT_THAT(input_error([&] { read_dataset(config); }),
              HasSubstr("cannot read topic /status: no definition of other_msgs/Status"));
}

// A message of an unknown package in a bag without definitions.
TEST(Db3, ReadsUnknownMessagesByTheirMsgFiles) {
  const TmpDir dir;
  Db3Writer writer(dir.path() / "a.db3");
  const int id = writer.add_topic("/dvl", "other_msgs/msg/DVL");
  writer.write(id, at(1), test::CdrBytes().header(at(1)).put(1.0).put(2.0).put(3.0).get());
  writer.close();
  auto config = config_for(dir.path() / "a.db3");
  config.message_definitions = (dir.path() / "defs").string();
  EXPECT_THAT(input_error([&] { read_dataset(config); }), HasSubstr("no .msg files"));
  dir.write("defs/other_msgs/msg/DVL.msg", "# a comment\nstd_msgs/Header header\nPart velocity\n");
  dir.write("defs/other_msgs/msg/Part.msg", "float64 x\nfloat64 y\nfloat64 z\n");
  const auto out = read_dataset(config);
  EXPECT_EQ(std::get<DvlSample>(out.events.at(0)).velocity, Eigen::Vector3d(1, 2, 3));
}

TEST(Db3, ReadsCompressedMessages) {
  const TmpDir dir;
  std::vector<Message> messages = recording();
  for (Message& m : messages) {
    std::vector<std::uint8_t> out(ZSTD_compressBound(m.bytes.size()));
    out.resize(ZSTD_compress(out.data(), out.size(), m.bytes.data(), m.bytes.size(), 1));
    m.bytes = out;
  }
  write_db3(dir.path() / "a.db3", messages);
  expect_recording(dir.path() / "a.db3");
}

TEST(Db3, KeepsReadablePartOfTruncatedFile) {
  const TmpDir dir;
  write_db3(dir.path() / "a.db3", recording());
  std::ostringstream content;
  content << std::ifstream(dir.path() / "a.db3", std::ios::binary).rdbuf();
  const std::string whole = content.str();
  testing::internal::CaptureStderr();
  const std::size_t count = imu_of(dir.write("cut.db3", whole.substr(0, whole.size() / 2)));
  const std::string text = testing::internal::GetCapturedStderr();
  EXPECT_GT(count, 100U);
  EXPECT_LT(count, 200U);
  EXPECT_THAT(text, HasSubstr("cut.db3: the bag is damaged"));
  EXPECT_EQ(text.find("is damaged"), text.rfind("is damaged")) << text;
}

TEST(Db3, OtherFilesAreRefused) {
  const TmpDir dir;
  EXPECT_THAT(input_error([&] { read_dataset(config_for(dir.write("a.db3", "no database"))); }),
              HasSubstr("a.db3: "));
  EXPECT_THAT(input_error([&] { read_dataset(config_for(dir.write("b.db3", ""))); }),
              HasSubstr("b.db3: not a recording, but an empty file"));
}

TEST(Rosbag2Folder, JoinsSplitFilesOfBothKinds) {
  const TmpDir dir;
  std::filesystem::create_directories(dir.path() / "bag");
  const auto all = recording();
  const auto part = [&](std::size_t from, std::size_t to) {
    return std::vector<Message>(all.begin() + static_cast<std::ptrdiff_t>(from),
                                all.begin() + static_cast<std::ptrdiff_t>(to));
  };
  dir.write("bag/bag_2.mcap", mcap_of(part(250, all.size()), {.compression = "zstd"}));
  write_db3(dir.path() / "bag/bag_1.db3", part(120, 250));
  dir.write("bag/bag_0.mcap", mcap_of(part(0, 120), {}));
  expect_recording(dir.path() / "bag");  // without metadata, as an interrupted recording leaves it
  dir.write("bag/metadata.yaml",
            "rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:\n"
            "    - bag_0.mcap\n    - bag_1.db3\n    - bag_2.mcap\n");
  expect_recording(dir.path() / "bag");
}

TEST(Rosbag2Folder, ReadsOnlyListedFilesAndItsRig) {
  const TmpDir dir;
  dir.write("bag/a.mcap", mcap_of(recording(), {}));
  dir.write("bag/b.mcap", "not listed");
  dir.write("bag/metadata.yaml", "rosbag2_bagfile_information:\n  relative_file_paths: [a.mcap]\n");
  dir.write("bag/rig.yaml", "imu0: {}\n");
  const auto out = read_dataset(config_for(dir.path() / "bag"));
  EXPECT_EQ(out.delivered("imu"), 300U);
  EXPECT_FALSE(out.report.contains("camera"));  // not in the rig
}

TEST(Rosbag2Folder, ErrorsSayWhatToDo) {
  const TmpDir dir;
  const std::string list = "rosbag2_bagfile_information:\n  relative_file_paths: [a.db3.zstd]\n";
  dir.write("bag/metadata.yaml", list);
  const auto error = [&] {
    return input_error([&] { read_dataset(config_for(dir.path() / "bag")); });
  };
  EXPECT_THAT(error(), HasSubstr("a.db3.zstd: no such file"));
  dir.write("bag/a.db3.zstd", "x");
  EXPECT_THAT(error(), HasSubstr("run \"zstd -d"));
  write_db3(dir.path() / "bag/a.db3", recording());  // decompressed by the user
  expect_recording(dir.path() / "bag");
}

}  // namespace
}  // namespace apvi
