// SPDX-License-Identifier: BSD-3-Clause
#include "runs/maps/tone_curve.hpp"

#include <gtest/gtest.h>

#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

using mapping::ToneCurveKind;

RunConfig config_of(const std::filesystem::path& recording) {
  RunConfig config;
  config.dataset.path = recording.string();
  return config;
}

ToneCurveKind kind_of(const RunConfig& config) {
  return with_tone_curve(config).mapping.trainer.tone_curve.kind;
}

TEST(ToneCurveOfARecording, IsSrgbForJpegFiles) {
  const test::TmpDir dir;
  dir.write("mav0/cam0/data/1.JPG", "");
  EXPECT_TRUE(has_jpeg_images(dir.path()));
  EXPECT_EQ(kind_of(config_of(dir.path())), ToneCurveKind::srgb);
}

TEST(ToneCurveOfARecording, IsLeftToTheImagesForPngFiles) {
  const test::TmpDir dir;
  dir.write("mav0/cam0/data/1.png", "");
  EXPECT_FALSE(has_jpeg_images(dir.path()));
  EXPECT_EQ(kind_of(config_of(dir.path())), ToneCurveKind::estimated);
  EXPECT_EQ(kind_of(config_of(dir.path() / "a.bag")), ToneCurveKind::estimated);
}

TEST(ToneCurveOfARecording, IsTheGivenOne) {
  const test::TmpDir dir;
  dir.write("mav0/cam0/data/1.jpg", "");
  RunConfig config = config_of(dir.path());
  config.mapping.trainer.tone_curve.kind = ToneCurveKind::linear;
  EXPECT_EQ(kind_of(config), ToneCurveKind::linear);
}

TEST(ToneCurveOfARecording, IsSrgbForLiveVideo) {
  RunConfig config = config_of("/nowhere");
  config.live.sources = {"waterlinked://192.168.2.95", "rtsp://192.168.2.10/stream"};
  EXPECT_EQ(kind_of(config), ToneCurveKind::srgb);
  config.live.sources = {"waterlinked://192.168.2.95"};
  EXPECT_EQ(kind_of(config), ToneCurveKind::estimated);
}

}  // namespace
}  // namespace apvi::runs
