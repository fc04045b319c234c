// SPDX-License-Identifier: BSD-3-Clause
#include "importer/mp4.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "apvi/core/error.hpp"
#include "importer/mp4_bytes.hpp"
#include "io/dataset_builder.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::importer {
namespace {

using namespace test;
using testing::HasSubstr;

Mp4Movie parse(const std::string& moov) {
  return parse_moov(as_bytes(moov), "clip.mp4");
}

TEST(Mp4, FindsSizesOffsetsAndTimesOfSamples) {
  const Mp4Movie movie = parse(mvhd() + trak({.timescale = 500,
                                              .sample_ticks = 250,
                                              .sizes = {10, 20, 30},
                                              .chunk_offsets = {1000, 5000},
                                              .samples_per_chunk = 2}));
  const Mp4Track* track = movie.with_format("gpmd");
  ASSERT_NE(track, nullptr);
  ASSERT_EQ(track->samples.size(), 3U);
  EXPECT_EQ(track->samples[1].offset, 1010U);
  EXPECT_EQ(track->samples[2].offset, 5000U);
  EXPECT_EQ(track->samples[2].size, 30U);
  EXPECT_DOUBLE_EQ(track->samples[2].time_s, 1.0);
  EXPECT_DOUBLE_EQ(track->samples[2].duration_s, 0.5);
}

TEST(Mp4, EditListDelaysATrackAndSkipsItsBeginning) {
  const std::string empty_edit = u32(200) + u32(0xFFFFFFFF) + u32(0x10000);
  const std::string edit = u32(1000) + u32(300) + u32(0x10000);
  const Mp4Movie movie = parse(mvhd(0, 1000) + trak({.handler = "vide",
                                                     .format = "avc1",
                                                     .timescale = 1000,
                                                     .sample_ticks = 100,
                                                     .sizes = {1, 1},
                                                     .chunk_offsets = {0},
                                                     .samples_per_chunk = 2,
                                                     .composition_offsets = {300, 400},
                                                     .edits = empty_edit + edit,
                                                     .edit_count = 2}));
  const Mp4Track* track = movie.with_handler("vide");
  ASSERT_NE(track, nullptr);
  EXPECT_DOUBLE_EQ(track->first_s(), 0.2);
  EXPECT_DOUBLE_EQ(track->samples[1].time_s, 0.4);
}

TEST(Mp4, ImagesThatTheEditListHidesAreNotTheFirst) {
  const std::string edit = u32(1000) + u32(200) + u32(0x10000);
  const Mp4Movie movie = parse(mvhd() + trak({.handler = "vide",
                                              .format = "avc1",
                                              .sample_ticks = 100,
                                              .sizes = {1, 1, 1, 1},
                                              .chunk_offsets = {0},
                                              .samples_per_chunk = 4,
                                              .edits = edit,
                                              .edit_count = 1}));
  const Mp4Track* track = movie.with_handler("vide");
  ASSERT_NE(track, nullptr);
  EXPECT_DOUBLE_EQ(track->samples[0].time_s, -0.2);
  EXPECT_DOUBLE_EQ(track->first_s(), 0.0);
}

TEST(Mp4, CreationTimeIsUnixTime) {
  EXPECT_EQ(parse(mvhd(2'082'844'800U + 86'400U)).created_unix_s, 86'400);
  EXPECT_EQ(parse(mvhd(0)).created_unix_s, std::nullopt);
}

TEST(Mp4, RejectsTablesThatContradictEachOther) {
  const auto error = [](const TrackBytes& track) {
    return input_error([&] { parse(mvhd() + trak(track)); });
  };
  EXPECT_THAT(error({.sizes = {1, 1, 1}, .chunk_offsets = {0}}), HasSubstr("2 of 3 samples"));
  EXPECT_THAT(error({.timescale = 0, .sizes = {1}, .chunk_offsets = {0}}),
              HasSubstr("no time scale"));
}

TEST(Mp4, TableCannotClaimMoreSamplesThanItHolds) {
  std::string moov = mvhd() + trak({.sizes = {1, 2}, .chunk_offsets = {0, 9}});
  const std::size_t stsz = moov.find("stsz");
  moov.replace(stsz + 12, 4, u32(0x7FFFFFFF));
  EXPECT_THAT(input_error([&] { parse(moov); }), HasSubstr("claims 2147483647 samples"));
}

TEST(Mp4, SoundTracksAreNotRead) {
  const Mp4Movie movie = parse(mvhd() + trak({.handler = "soun", .format = "mp4a", .sizes = {1}}));
  ASSERT_NE(movie.with_handler("soun"), nullptr);
  EXPECT_TRUE(movie.with_handler("soun")->samples.empty());
}

TEST(Mp4, FileWithoutIndexIsAnInterruptedRecording) {
  const TmpDir dir;
  const auto file = dir.write("clip.mp4", box("ftyp", "mp42") + box("mdat", "abcdefgh"));
  EXPECT_TRUE(is_mp4(file));
  EXPECT_THAT(input_error([&] { read_mp4(file); }), HasSubstr("interrupted"));
}

TEST(Mp4, SampleBeyondTheEndOfTheFileIsAnError) {
  const TmpDir dir;
  const auto file = dir.write("clip.mp4", "0123456789");
  std::ifstream in(file, std::ios::binary);
  EXPECT_THAT(input_error([&] { read_sample(in, {.offset = 5, .size = 10}, "clip.mp4"); }),
              HasSubstr("incomplete"));
  EXPECT_EQ(read_sample(in, {.offset = 5, .size = 2}, "clip.mp4"),
            (std::vector<std::uint8_t>{'5', '6'}));
}

}  // namespace
}  // namespace apvi::importer
