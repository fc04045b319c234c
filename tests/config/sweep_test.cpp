// SPDX-License-Identifier: BSD-3-Clause
#include "config/sweep.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "apvi/core/error.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::config {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

class SweepTest : public testing::Test {
 protected:
  SweepTest() {
    dir_.write("base.yaml", "run: {seed: 7}\n");
    dir_.write("datasets/reef.yaml", "dataset: {path: reef}\n");
    dir_.write("datasets/wreck.yaml", "dataset: {path: wreck}\n");
  }
  Sweep load(const std::string& text) const {
    return load_sweep(dir_.write("sweeps/test.yaml", text));
  }
  std::string error(const std::string& text) const {
    try {
      load(text);
    } catch (const InputError& e) {
      return e.what();
    }
    return "no error";
  }
  static std::vector<std::string> folders(const Sweep& sweep) {
    std::vector<std::string> names;
    for (const SweepCase& one : sweep.cases) names.push_back(one.folder().string());
    return names;
  }
  // A value of a case's own configuration.
  static std::string value(const SweepCase& one, const std::vector<std::string>& path) {
    const Node* node = &one.config;
    for (const std::string& word : path) {
      node = node->find(word);
      if (node == nullptr) return "absent";
    }
    return internal::to_flow_yaml(*node);
  }

  test::TmpDir dir_;
};

TEST_F(SweepTest, HasOneCaseWithoutAxes) {
  const Sweep sweep = load("base: ../base.yaml\n");
  ASSERT_EQ(sweep.cases.size(), 1U);
  EXPECT_EQ(sweep.cases[0].folder(), "test");
  EXPECT_FALSE(sweep.cases[0].seed);
  EXPECT_EQ(value(sweep.cases[0], {"inherit"}), "[" + (dir_.path() / "base.yaml").string() + "]");
}

TEST_F(SweepTest, CombinesCasesGridAndSeeds) {
  const Sweep sweep = load(
      "base: ../base.yaml\n"
      "cases:\n"
      "  full: {}\n"
      "  blind: {sensors.use: [imu, dvl]}\n"
      "grid:\n"
      "  fusion.mode: [paper, consistent]\n"
      "seeds: 2\n");
  EXPECT_THAT(folders(sweep),
              ElementsAre("full_mode-paper/seed-1", "full_mode-paper/seed-2",
                          "full_mode-consistent/seed-1", "full_mode-consistent/seed-2",
                          "blind_mode-paper/seed-1", "blind_mode-paper/seed-2",
                          "blind_mode-consistent/seed-1", "blind_mode-consistent/seed-2"));
  const SweepCase& last = sweep.cases.back();
  EXPECT_EQ(value(last, {"sensors", "use"}), "[imu, dvl]");
  EXPECT_EQ(value(last, {"fusion", "mode"}), "consistent");
  EXPECT_EQ(value(last, {"run", "seed"}), "2");
  EXPECT_THAT(last.choices,
              ElementsAre(std::pair<std::string, std::string>("case", "blind"),
                          std::pair<std::string, std::string>("fusion.mode", "consistent")));
}

TEST_F(SweepTest, SupportsNamedAlternatives) {
  const Sweep sweep = load(
      "base: ../base.yaml\n"
      "grid:\n"
      "  sensors:\n"
      "    I+D: {sensors: {use: [imu, dvl]}, freeze.enabled: false}\n"
      "    all: {}\n");
  EXPECT_THAT(folders(sweep), ElementsAre("I+D", "all"));
  EXPECT_EQ(value(sweep.cases[0], {"freeze", "enabled"}), "false");
  EXPECT_EQ(value(sweep.cases[0], {"sensors", "use"}), "[imu, dvl]");
  EXPECT_EQ(value(sweep.cases[1], {"freeze", "enabled"}), "absent");
}

TEST_F(SweepTest, SupportsConfigurationFilesAsAxis) {
  const Sweep sweep = load("grid: {base: [../datasets/reef.yaml, ../datasets/wreck.yaml]}\n");
  EXPECT_THAT(folders(sweep), ElementsAre("reef", "wreck"));
  EXPECT_THAT(value(sweep.cases[1], {"inherit"}), HasSubstr("/datasets/wreck.yaml]"));
  EXPECT_EQ(value(sweep.cases[1], {"base"}), "absent");
}

TEST_F(SweepTest, CaseOverridesCommonKeys) {
  const Sweep sweep = load(
      "base: [../base.yaml, ../datasets/reef.yaml]\n"
      "set: {run: {threads: 1}, localization.gravity: 9.7}\n"
      "cases: {one: {run.threads: 4}}\n");
  EXPECT_EQ(value(sweep.cases[0], {"run", "threads"}), "4");
  EXPECT_EQ(value(sweep.cases[0], {"localization", "gravity"}), "9.7");
}

TEST_F(SweepTest, FolderNamesAreSanitizedAndUnique) {
  const Sweep sweep = load(
      "base: ../base.yaml\n"
      "grid: {dataset.path: [/data/a/dive one/, /data/b/dive one, dive:one]}\n");
  EXPECT_THAT(folders(sweep), ElementsAre("path-dive_one", "path-dive_one_2", "path-dive_one_3"));
  EXPECT_EQ(load("base: ../base.yaml\ncases: {cases: {}}\n").cases[0].folder(), "_cases");
  EXPECT_EQ(load("base: ../base.yaml\ncases: {../up: {}}\n").cases[0].folder(), "_._up");
}

TEST_F(SweepTest, LabelsOfOneAxisAreUnique) {
  const Sweep sweep = load(
      "base: ../base.yaml\n"
      "grid: {dataset.path: [/data/monday/dive, /data/tuesday/dive, /data/reef, /data/reef]}\n");
  std::vector<std::string> labels;
  for (const SweepCase& one : sweep.cases) labels.push_back(one.choices.at(0).second);
  EXPECT_THAT(labels, ElementsAre("monday/dive", "tuesday/dive", "data/reef", "data/reef_2"));
}

TEST_F(SweepTest, SetsSceneSeed) {
  const Sweep sweep = load("command: sim\nbase: ../base.yaml\nseeds: [3, 9]\n");
  EXPECT_EQ(value(sweep.cases[1], {"seed"}), "9");
}

TEST_F(SweepTest, CaseConfigRoundTrips) {
  const Sweep sweep = load("base: ../base.yaml\nset: {sensors.use: [imu, dvl]}\nseeds: 1\n");
  const auto file = dir_.write("case.yaml", to_yaml(sweep.cases[0].config));
  const Node node = load_with_inheritance(file);
  EXPECT_EQ(internal::to_flow_yaml(*node.find("sensors")->find("use")), "[imu, dvl]");
  EXPECT_EQ(node.find("run")->find("seed")->text, "1");
}

TEST_F(SweepTest, SearchesFoldersForBaseAndInheritedFiles) {
  const auto file = dir_.write("mine/sweep.yaml", "inherit: common.yaml\nbase: base.yaml\n");
  dir_.write("configs/common.yaml", "seeds: 2\n");
  dir_.write("configs/base.yaml", "run: {seed: 7}\n");
  const Sweep sweep = load_sweep(file, {dir_.path() / "configs"});
  ASSERT_EQ(sweep.cases.size(), 2U);
  EXPECT_EQ(sweep.cases[0].config.find("inherit")->items.at(0).text,
            (dir_.path() / "configs/base.yaml").string());
}

TEST_F(SweepTest, ErrorsNameLine) {
  const std::string base = "base: ../base.yaml\n";
  EXPECT_THAT(error("seeds: 3\n"), HasSubstr("test.yaml: base: missing"));
  EXPECT_THAT(error("base: ../bass.yaml\n"), HasSubstr("test.yaml:1: base: no such file"));
  EXPECT_THAT(error(base + "grid: {run.seed: []}\n"), HasSubstr("test.yaml:2: run.seed: expected"));
  EXPECT_THAT(error(base + "grid: [1]\n"), HasSubstr("test.yaml:2: grid: expected"));
  EXPECT_THAT(error(base + "cases: [1]\n"), HasSubstr("test.yaml:2: cases: expected"));
  EXPECT_THAT(error(base + "cases: {a: 3}\n"), HasSubstr("test.yaml:2: case.a: expected"));
  EXPECT_THAT(error(base + "set: 3\n"), HasSubstr("test.yaml:2: set: expected"));
  EXPECT_THAT(error(base + "set: {a..b: 3}\n"), HasSubstr("empty key"));
  EXPECT_THAT(error(base + "seeds: [a]\n"), HasSubstr("test.yaml:2: seeds"));
  EXPECT_THAT(error(base + "seeds: 0\n"), HasSubstr("test.yaml:2: seeds: expected at least one"));
  EXPECT_THAT(error(base + "seeds: 1000000\n"), HasSubstr("too many"));
  EXPECT_THAT(error(base + "gird: {}\n"), HasSubstr("gird"));
  EXPECT_THAT(error(base + "seeds: 100000\ngrid: {a: [1, 2]}\n"), HasSubstr("more than 100000"));
}

}  // namespace
}  // namespace apvi::config
