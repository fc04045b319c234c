// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <string>

#include "importer/matroska.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::importer {
namespace {

using test::TmpDir;

std::string bytes(std::initializer_list<int> values) {
  std::string text;
  for (const int value : values) text += static_cast<char>(value);
  return text;
}

// An element of fewer than 127 bytes.
std::string element(const std::string& id, const std::string& content) {
  return id + static_cast<char>(0x80 + content.size()) + content;
}

const std::string kHeader = element(bytes({0x1A, 0x45, 0xDF, 0xA3}), bytes({0x42, 0x82, 0x80}));
const std::string kSegment = bytes(
    {0x18, 0x53, 0x80, 0x67, 0x01, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF});  // of unknown size
const std::string kVoid = element(bytes({0xEC}), std::string(9, '\0'));
const std::string kScale = element(bytes({0x2A, 0xD7, 0xB1}), bytes({0x0F, 0x42, 0x40}));
// 2024-05-01T12:51:30.25Z is 736260690.25 s after 2001-01-01 (Python's datetime).
const std::string kDate =
    element(bytes({0x44, 0x61}), bytes({0x0A, 0x37, 0xB9, 0x32, 0x68, 0x6F, 0x66, 0x80}));

std::string info(const std::string& content) {
  return element(bytes({0x15, 0x49, 0xA9, 0x66}), content);
}

std::optional<Stamp> date_of(const std::string& content) {
  const TmpDir dir;
  return matroska_date(dir.write("clip.mkv", content));
}

TEST(Matroska, HasTheDateOfItsInfo) {
  const auto date = date_of(kHeader + kSegment + kVoid + info(kScale + kDate));
  ASSERT_TRUE(date);
  EXPECT_EQ(date->ns, 1'714'567'890'250'000'000);
}

TEST(Matroska, WithoutADateHasNone) {
  const std::string cluster = element(bytes({0x1F, 0x43, 0xB6, 0x75}), "");
  EXPECT_FALSE(date_of(kHeader + kSegment + info(kScale)));
  EXPECT_FALSE(date_of(kHeader + kSegment + cluster + info(kDate)));
}

TEST(Matroska, DamagedAndOtherFilesHaveNoDate) {
  const std::string whole = kHeader + kSegment + kVoid + info(kScale + kDate);
  for (std::size_t length = 0; length < whole.size(); ++length)
    EXPECT_FALSE(date_of(whole.substr(0, length))) << length;
  EXPECT_FALSE(
      date_of(std::string("\0\0\0\x18"
                          "ftypmp42",
                          12)));
  EXPECT_FALSE(matroska_date("nothing.mkv"));
}

}  // namespace
}  // namespace apvi::importer
