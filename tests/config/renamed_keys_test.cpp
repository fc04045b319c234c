// SPDX-License-Identifier: BSD-3-Clause
#include "config/renamed_keys.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "apvi/core/error.hpp"
#include "config/example_config.hpp"
#include "config/sweep.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::config {
namespace {

using test::ExampleConfig;
using testing::HasSubstr;

double halved(double value) {
  return 0.5 * value;
}

constexpr std::array<RenamedKey, 6> kKeys = {
    {{"follower", "tracker"},
     {"follower.reach_px", "tracker.min_distance_px", halved},
     {"follower.color", ""},
     {"follower.corners", "tracker.max_features"},
     {"frequency", "rate_hz"},
     {"frame_rate", "rate_hz"}}};
constexpr std::array<RenamedValue, 1> kValues = {{{"mode", "loose", "paper"}}};
constexpr Renames kRenames{kKeys, kValues};

class RenamedKeysTest : public testing::Test {
 protected:
  // Loads a file and keeps what is written to standard error.
  ExampleConfig load(const std::string& yaml, const std::vector<std::string>& overrides = {}) {
    testing::internal::CaptureStderr();
    ExampleConfig example;
    try {
      read(load_config(dir_.write("a.yaml", yaml), overrides, kRenames), example);
    } catch (const InputError& e) {
      error_ = e.what();
    }
    log_ = testing::internal::GetCapturedStderr();
    return example;
  }
  std::string file() const { return (dir_.path() / "a.yaml").string(); }

  test::TmpDir dir_;
  std::string log_;
  std::string error_;
};

TEST_F(RenamedKeysTest, NewNamesGiveNoWarning) {
  EXPECT_EQ(load("rate_hz: 5\ntracker: {max_features: 30}\n").tracker.max_features, 30);
  EXPECT_EQ(log_, "");
}

TEST_F(RenamedKeysTest, OldKeySetsFieldAndGivesOneWarning) {
  EXPECT_EQ(load("seed: 1\nfrequency: 5\n").rate_hz, 5.0);
  EXPECT_EQ(log_,
            "warning: " + file() + ":2: frequency is now rate_hz; the old name works until 0.3\n");
}

TEST_F(RenamedKeysTest, RenamedSectionMayContainRenamedKeys) {
  const ExampleConfig c = load("follower: {corners: 40, min_distance_px: 9}\n");
  EXPECT_EQ(c.tracker.max_features, 40);
  EXPECT_EQ(c.tracker.min_distance_px, 9.0);
  EXPECT_THAT(log_, HasSubstr("follower.corners is now tracker.max_features"));
  EXPECT_THAT(log_, HasSubstr("follower is now tracker;"));
}

TEST_F(RenamedKeysTest, ValueInAnotherUnitIsConverted) {
  EXPECT_EQ(load("follower: {reach_px: 30}\n").tracker.min_distance_px, 15.0);
  EXPECT_THAT(log_, HasSubstr("follower.reach_px is now tracker.min_distance_px;"));
  EXPECT_EQ(load("seed: 1\n", {"follower.reach_px=8"}).tracker.min_distance_px, 4.0);
  EXPECT_EQ(error_, "");
}

TEST_F(RenamedKeysTest, KeyWithoutEffectGivesAWarning) {
  EXPECT_EQ(load("follower: {color: red, corners: 40}\n").tracker.max_features, 40);
  EXPECT_EQ(error_, "");
  EXPECT_THAT(log_, HasSubstr("follower.color has no effect any more; delete it before 0.3"));
  EXPECT_EQ(load("seed: 1\n", {"follower.color=red"}).tracker.max_features,
            test::TrackerConfig{}.max_features);
  EXPECT_EQ(error_, "");
}

TEST_F(RenamedKeysTest, OldSectionAndNewSectionAreMerged) {
  const ExampleConfig c = load("follower: {corners: 40}\ntracker: {min_distance_px: 9}\n");
  EXPECT_EQ(c.tracker.max_features, 40);
  EXPECT_EQ(c.tracker.min_distance_px, 9.0);
}

TEST_F(RenamedKeysTest, OldValueIsReplaced) {
  EXPECT_EQ(load("mode: loose\n").mode, test::Mode::paper);
  EXPECT_THAT(log_, HasSubstr("a.yaml:1: mode: loose is now paper;"));
}

TEST_F(RenamedKeysTest, OldAndNewNameInOneFileAreAnError) {
  load("rate_hz: 5\nfrequency: 5\n");
  EXPECT_EQ(error_, file() +
                        ":2: frequency: this key is now rate_hz, which is given too; delete one "
                        "of them");
  load("tracker: {max_features: 30}\nfollower: {corners: 30}\n");
  EXPECT_THAT(error_, HasSubstr("follower.corners: this key is now tracker.max_features"));
}

TEST_F(RenamedKeysTest, OldKeysWithTheSameNewNameMustAgree) {
  EXPECT_EQ(load("frequency: 5\nframe_rate: 5\n").rate_hz, 5.0);
  EXPECT_EQ(error_, "");
  load("frequency: 5\nframe_rate: 6\n");
  EXPECT_THAT(error_, HasSubstr("frame_rate: this key is now rate_hz"));
}

TEST_F(RenamedKeysTest, NewNameOverridesOldNameOfInheritedFile) {
  dir_.write("parent.yaml", "frequency: 5\nfollower: {corners: 40, min_distance_px: 9}\n");
  const ExampleConfig c = load("inherit: parent.yaml\nrate_hz: 7\nfollower: {corners: 50}\n");
  EXPECT_EQ(error_, "");
  EXPECT_EQ(c.rate_hz, 7.0);
  EXPECT_EQ(c.tracker.max_features, 50);
  EXPECT_EQ(c.tracker.min_distance_px, 9.0);
  const std::size_t first = log_.find("follower.corners is now");
  EXPECT_NE(first, std::string::npos);
  EXPECT_EQ(log_.find("follower.corners is now", first + 1), std::string::npos);
}

TEST_F(RenamedKeysTest, OverridesAcceptOldNames) {
  const ExampleConfig c = load("rate_hz: 5\ntracker: {max_features: 30, min_distance_px: 9}\n",
                               {"frequency=7", "follower.corners=50"});
  EXPECT_EQ(c.rate_hz, 7.0);
  EXPECT_EQ(c.tracker.max_features, 50);
  EXPECT_EQ(c.tracker.min_distance_px, 9.0);
  EXPECT_THAT(log_, HasSubstr("--set: frequency is now rate_hz;"));
}

TEST_F(RenamedKeysTest, OverrideOfASectionReplacesIt) {
  const ExampleConfig c =
      load("tracker: {max_features: 30, min_distance_px: 9}\n", {"follower={corners: 50}"});
  EXPECT_EQ(c.tracker.max_features, 50);
  EXPECT_EQ(c.tracker.min_distance_px, test::TrackerConfig{}.min_distance_px);
}

TEST_F(RenamedKeysTest, OverridesByOldAndNewNameAreAnError) {
  load("seed: 1\n", {"frequency=7", "rate_hz=8"});
  EXPECT_THAT(error_, HasSubstr("frequency and rate_hz are the same key"));
}

TEST_F(RenamedKeysTest, RecordedConfigGivesNoWarning) {
  testing::internal::CaptureStderr();
  ExampleConfig c;
  read(load_recorded_config(dir_.write("resolved.yaml", "frequency: 5\n"), kRenames), c);
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  EXPECT_EQ(c.rate_hz, 5.0);
}

TEST_F(RenamedKeysTest, SweepsAcceptOldNames) {
  dir_.write("base.yaml", "run: {seed: 7}\n");
  testing::internal::CaptureStderr();
  const Sweep sweep = load_sweep(
      dir_.write("sweep.yaml",
                 "base: base.yaml\n"
                 "set: {run.pace: 2}\n"
                 "cases: {a: {vio: {start: {dvl_s: 4}}}}\n"
                 "grid: {mapping.loops.least_age_s: [10, 30], mapping.revisits: [loops]}\n"));
  const std::string log = testing::internal::GetCapturedStderr();
  ASSERT_EQ(sweep.cases.size(), 2U);
  EXPECT_EQ(sweep.cases[1].choices[1].first, "mapping.loop_closure.min_age_s");
  EXPECT_THAT(to_yaml(sweep.cases[1].config),
              testing::AllOf(HasSubstr("playback_rate: 2"), HasSubstr("dvl_aiding_s: 4"),
                             HasSubstr("min_age_s: 30"), HasSubstr("method: pose_graph")));
  EXPECT_THAT(log, HasSubstr("sweep.yaml:4: mapping.loops.least_age_s is now"));
  EXPECT_EQ(log.find("least_age_s is now"), log.rfind("least_age_s is now"));
}

TEST(RenameTables, OldNamesAreUniqueAndNotReused) {
  for (const Renames* renames : {&run_renames(), &scene_renames()}) {
    std::set<std::string_view> old_keys;
    for (const RenamedKey& key : renames->keys) EXPECT_TRUE(old_keys.insert(key.old_key).second);
    for (const RenamedKey& key : renames->keys) {
      EXPECT_FALSE(old_keys.contains(key.new_key)) << key.new_key;
    }
  }
}

}  // namespace
}  // namespace apvi::config
