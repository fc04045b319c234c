// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag/ros_message.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <boost/uuid/detail/md5.hpp>
#include <map>
#include <sstream>

#include "apvi/core/error.hpp"
#include "io/dataset_builder.hpp"
#include "io/folder/image_decode.hpp"
#include "io/ros_bytes.hpp"
#include "io/rosbag/ros_definitions.hpp"
#include "io/rosbag/ros_samples.hpp"

namespace apvi {
namespace {

using io::RosMessageType;
using test::input_error;
using test::kHeaderPart;
using test::kSeparator;
using test::RosBytes;
using testing::HasSubstr;

std::string md5(const std::string& text) {
  boost::uuids::detail::md5 hash;
  hash.process_bytes(text.data(), text.size());
  boost::uuids::detail::md5::digest_type digest;
  hash.get_digest(digest);
  std::string hex;
  // Four words or sixteen bytes, depending on the Boost version.
  for (const auto part : digest) hex += fmt::format("{:0{}x}", part, 2 * sizeof(part));
  return hex;
}

// ROS message checksum: the fields line by line, with nested types replaced by their checksums.
// Constants are not supported; the definitions here have none.
std::string checksum(const std::map<std::string, std::string>& blocks, const std::string& name) {
  std::istringstream lines(blocks.at(name));
  std::string sum;
  std::string type;
  for (std::string field; lines >> type >> field;) {
    const std::string base = type.substr(0, type.find('['));
    const std::string own = name.substr(0, name.find('/')) + "/" + base;
    const std::string full = base == "Header"       ? "std_msgs/Header"
                             : blocks.contains(own) ? own
                                                    : base;
    if (!sum.empty()) sum += "\n";
    sum += (blocks.contains(full) ? checksum(blocks, full) : type) + " " + field;
  }
  return md5(sum);
}

std::string checksum(const io::RosDefinition& definition) {
  std::map<std::string, std::string> blocks;
  std::string* block = &blocks[definition.type];
  std::istringstream lines(definition.text);
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("MSG: ")) {
      block = &blocks[line.substr(5)];
    } else if (!line.starts_with("===")) {
      *block += line + "\n";
    }
  }
  return checksum(blocks, definition.type);
}

TEST(RosDefinitions, HavePublishedChecksums) {
  EXPECT_EQ(checksum(io::imu_definition()), "6a62c6daae103f4ff57a132d6f95cec2");
  EXPECT_EQ(checksum(io::fluid_pressure_definition()), "804dc5cea1c5306d6a2eb80b9833befe");
  EXPECT_EQ(checksum(io::odometry_definition()), "cd5e73d190d741a2f92e81eda573aca7");
  EXPECT_EQ(checksum(io::compressed_image_definition()), "8f7a12909da2c9d3332d540a0977563f");
  EXPECT_EQ(checksum(io::waterlinked_dvl_definition()), "dea1debc1aca7804a62c507714ec3777");
  for (const auto* definition :
       {&io::imu_definition(), &io::fluid_pressure_definition(), &io::odometry_definition(),
        &io::compressed_image_definition(), &io::waterlinked_dvl_definition()}) {
    EXPECT_EQ(checksum(*definition), definition->md5) << definition->type;
  }
  // The nested type has a published checksum too.
  const std::string text = io::waterlinked_dvl_definition().text;
  EXPECT_EQ(md5(text.substr(text.rfind("int64 id"), text.size() - 1 - text.rfind("int64 id"))),
            "750bcc69eae0dec5dc80e15e3ced915b");
}

TEST(RosMessages, DecodeEveryFieldType) {
  const RosMessageType type("test_msgs/All",
                            "# all kinds\nint8 A=1\nstring B= x # y\nbool flag # tail\nint8 i8\n"
                            "byte b\nchar c\nuint16 u16\nint32 i32\nuint64 u64\nfloat32 f\n"
                            "time t\nduration d\nstring s\nfloat64[3] fixed\nint16[] some\n"
                            "string[] words\nPart[2] parts\nother_msgs/Part[] more\n" +
                                kSeparator + "test_msgs/Part\nuint8 x\n" + kSeparator +
                                "other_msgs/Part\nuint8[] y\n");
  RosBytes bytes;
  bytes.put(std::uint8_t{1}).put(std::int8_t{-2}).put(std::int8_t{-3}).put(std::uint8_t{200});
  bytes.put(std::uint16_t{65535}).put(std::int32_t{-70000}).put(std::uint64_t{1} << 40U);
  bytes.put(1.5F).put(std::uint32_t{3}).put(std::uint32_t{5}).put(1).put(2).text("hello");
  bytes.put(1.0).put(2.0).put(3.0).put(std::uint32_t{2}).put(std::int16_t{-4}).put(std::int16_t{6});
  bytes.put(std::uint32_t{2}).text("a").text("").put(std::uint8_t{8}).put(std::uint8_t{9});
  bytes.put(std::uint32_t{1}).put(std::uint32_t{2}).put(std::uint8_t{10}).put(std::uint8_t{11});
  const auto value = type.decode(bytes.get());
  ASSERT_TRUE(value);
  EXPECT_EQ(value->number_at("flag"), 1.0);
  EXPECT_EQ(value->number_at("i8"), -2.0);
  EXPECT_EQ(value->number_at("b"), -3.0);
  EXPECT_EQ(value->number_at("c"), 200.0);
  EXPECT_EQ(value->number_at("u16"), 65535.0);
  EXPECT_EQ(value->number_at("i32"), -70000.0);
  EXPECT_EQ(value->number_at("u64"), 1099511627776.0);
  EXPECT_EQ(value->number_at("f"), 1.5);
  EXPECT_EQ(value->find("t")->nanoseconds(), 3'000'000'005);
  EXPECT_EQ(value->find("s")->text(), "hello");
  EXPECT_EQ(value->find("fixed")->number(2), 3.0);
  EXPECT_FALSE(value->find("fixed")->number(3));
  EXPECT_EQ(value->find("some")->number(0), -4.0);
  EXPECT_EQ(value->find("words")->items().at(0).text(), "a");
  EXPECT_EQ(value->find("parts")->items().at(1).number_at("x"), 9.0);
  EXPECT_EQ(value->find("more")->items().at(0).find("y")->bytes()[1], 11);
  EXPECT_EQ(value->find("nothing"), nullptr);
  EXPECT_EQ(value->find("s.deeper"), nullptr);
  EXPECT_FALSE(value->number_at("s"));
}

TEST(RosMessages, RejectWrongSize) {
  const RosMessageType type("a/B", "uint32 n\nstring[] words\nfloat64[] x\n");
  RosBytes good;
  good.put(std::uint32_t{1}).put(std::uint32_t{1}).text("w").put(std::uint32_t{1}).put(2.5);
  ASSERT_TRUE(type.decode(good.get()));
  for (std::size_t size = 0; size < good.get().size(); ++size) {
    EXPECT_FALSE(type.decode(std::span(good.get()).first(size))) << size;
  }
  good.put(std::uint8_t{0});
  EXPECT_FALSE(type.decode(good.get()));
  const auto huge = RosBytes().put(std::uint32_t{1}).put(~std::uint32_t{0}).get();
  EXPECT_FALSE(type.decode(huge));
}

TEST(RosMessages, RejectExcessiveZeroSizeValues) {
  const RosMessageType type("a/B", "C[1000] c\n" + kSeparator + "a/C\nD[1000] d\n" + kSeparator +
                                       "a/D\nE[1000] e\n" + kSeparator + "a/E\n");
  EXPECT_FALSE(type.decode({}));
}

TEST(RosMessages, RejectInvalidDefinitions) {
  const auto error = [](const std::string& definition) {
    return input_error([&] { RosMessageType("a/B", definition); });
  };
  EXPECT_THAT(error("C c\n"), HasSubstr("a/B: no definition of its type C"));
  EXPECT_THAT(error("B b\n"), HasSubstr("recursive types"));
  EXPECT_THAT(error("uint8\n"), HasSubstr("cannot read the line"));
  EXPECT_THAT(error("uint8[x] y\n"), HasSubstr("cannot read the type"));
  EXPECT_THAT(error("uint8[-1] y\n"), HasSubstr("cannot read the type"));
  EXPECT_THAT(error("uint8[ y\n"), HasSubstr("cannot read the type"));
  EXPECT_EQ(error(""), "");
}

TEST(RosSamples, DecodesRawImagesByEncoding) {
  const RosMessageType type("sensor_msgs/Image",
                            "Header header\nuint32 height\nuint32 width\nstring encoding\n"
                            "uint8 is_bigendian\nuint32 step\nuint8[] data\n" +
                                kHeaderPart);
  const auto image = [&](const std::string& encoding, std::uint32_t step,
                         const std::vector<std::uint8_t>& data, std::uint8_t big_endian = 0) {
    RosBytes bytes;
    bytes.header(1, 0).put(2U).put(2U).text(encoding).put(big_endian).put(step);
    bytes.put(static_cast<std::uint32_t>(data.size()));
    for (const auto byte : data) bytes.put(byte);
    return io::image_of(0, "/cam")(type.decode(bytes.get()).value(), Stamp{1});
  };
  const auto pixels = [](const std::optional<SensorEvent>& event) {
    const cv::Mat m = std::get<ImageFrame>(event.value()).decode();
    return std::vector<int>(m.begin<std::uint8_t>(), m.end<std::uint8_t>());
  };
  EXPECT_THAT(pixels(image("mono8", 3, {1, 2, 99, 3, 4, 99})), testing::ElementsAre(1, 2, 3, 4));
  EXPECT_THAT(pixels(image("mono16", 4, {0, 1, 0, 2, 0, 3, 0, 200})),
              testing::ElementsAre(1, 2, 3, 200));
  EXPECT_THAT(pixels(image("mono16", 4, {1, 0, 2, 0, 3, 0, 200, 0}, 1)),
              testing::ElementsAre(1, 2, 3, 200));
  const std::vector<std::uint8_t> rgb = {1, 2, 3, 1, 2, 3, 1, 2, 3, 1, 2, 3};
  EXPECT_EQ(std::get<ImageFrame>(*image("rgb8", 6, rgb)).decode().at<cv::Vec3b>(0, 0),
            cv::Vec3b(3, 2, 1));
  EXPECT_EQ(std::get<ImageFrame>(*image("bgr8", 6, rgb)).decode().at<cv::Vec3b>(0, 0),
            cv::Vec3b(1, 2, 3));
  EXPECT_FALSE(image("mono8", 2, {1, 2, 3}));        // truncated
  EXPECT_FALSE(image("mono8", 1, {1, 2, 3, 4, 5}));  // step smaller than the width
  EXPECT_THROW(pixels(image("32FC1", 8, {1, 2, 3, 4, 5})), RunError);  // neither 8 nor 16 bits
  EXPECT_FALSE(image("mono8", 2, {}));
}

TEST(RosSamples, DecodesBayerPatterns) {
  // A uniformly red scene: only the red pixels of the mosaic are nonzero.
  const auto decode = [](const std::string& encoding, std::size_t red_row, std::size_t red_col) {
    std::vector<std::uint8_t> data(64, 0);
    for (std::size_t row = red_row; row < 8; row += 2) {
      for (std::size_t col = red_col; col < 8; col += 2) data[row * 8 + col] = 200;
    }
    io::RawImage raw;
    raw.bytes = data;
    raw.width = raw.height = raw.step = 8;
    raw.encoding = encoding;
    return io::decode_raw_image(raw).at<cv::Vec3b>(4, 4);
  };
  for (const auto& bgr : {decode("bayer_rggb8", 0, 0), decode("bayer_bggr8", 1, 1),
                          decode("bayer_grbg8", 0, 1), decode("bayer_gbrg8", 1, 0)}) {
    EXPECT_EQ(bgr, cv::Vec3b(0, 0, 200));
  }
}

}  // namespace
}  // namespace apvi
