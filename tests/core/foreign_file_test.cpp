// SPDX-License-Identifier: BSD-3-Clause
#include "core/foreign_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/tmp_dir.hpp"

namespace apvi {
namespace {

using testing::HasSubstr;
using namespace std::string_literals;

std::string described(const std::string& name, const std::string& content) {
  const test::TmpDir dir;
  return describe_foreign_file(dir.write(name, content)).value_or("");
}

TEST(ForeignFile, IsDescribedByItsContent) {
  EXPECT_THAT(described("dive.zip", "PK\x03\x04 and more"), HasSubstr("zip archive: unpack"));
  EXPECT_THAT(described("dive", "PK\x03\x04 and more"), HasSubstr("zip archive"));
  EXPECT_THAT(described("dive.tgz", "\x1F\x8B\x08 and more"), HasSubstr("gzip"));
  EXPECT_THAT(described("dive.mcap.zstd", "\x28\xB5\x2F\xFD and more"), HasSubstr("zstd -d"));
  EXPECT_THAT(described("dive.bag", "SQLite format 3\0"s), HasSubstr("end in .db3"));
  EXPECT_THAT(described("dive.bag", "\x89MCAP0\r\n"), HasSubstr("end in .mcap"));
  EXPECT_THAT(described("dive.bag", ""), HasSubstr("an empty file"));
  EXPECT_THAT(described("dive.bag", std::string(600, '\0')), HasSubstr("zeros only"));
}

TEST(ForeignFile, IsDescribedByItsName) {
  EXPECT_THAT(described("dive.h264", "\0\0\0\1g"s), HasSubstr("ffmpeg -framerate 30"));
  EXPECT_THAT(described("DIVE.HEVC", "\0\0\0\1@"s), HasSubstr("raw video stream"));
  EXPECT_THAT(described("map.splat", "1234"), HasSubstr("a .splat map"));
  EXPECT_THAT(described("map.ksplat", "1234"), HasSubstr("export it as .ply"));
  EXPECT_THAT(described("map.ply", "ply\n"), HasSubstr("apvi view"));
  EXPECT_THAT(described("a.jpg", "\xFF\xD8"), HasSubstr("folder of the images"));
}

TEST(ForeignFile, FilesThatAreReadHaveNoDescription) {
  EXPECT_EQ(described("dive.bag", "#ROSBAG V2.0\n"), "");
  EXPECT_EQ(described("dive.db3", "SQLite format 3\0"s), "");
  EXPECT_EQ(described("dive.mcap", "\x89MCAP0\r\n"), "");
  EXPECT_THAT(described("map.spz", "\x1F\x8B\x08"), HasSubstr("apvi view"));
  EXPECT_EQ(described("run.yaml", "run: {}\n"), "");
  EXPECT_EQ(describe_foreign_file("/nowhere/dive.zip"), std::nullopt);
  EXPECT_EQ(describe_foreign_file("/"), std::nullopt);
}

}  // namespace
}  // namespace apvi
