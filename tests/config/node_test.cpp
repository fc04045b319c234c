// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/config/node.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "apvi/core/error.hpp"
#include "config/example_config.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::config {
namespace {

using test::ExampleConfig;
using testing::ElementsAre;
using testing::HasSubstr;

// The message of the InputError that `f` throws, or "" when it throws none.
template <typename F>
std::string error_of(const F& f) {
  try {
    f();
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

std::string parse_error_of(const std::string& yaml) {
  return error_of([&] { parse_yaml(yaml, "a.yaml"); });
}

ExampleConfig as_example(const Node& node) {
  ExampleConfig example;
  read(node, example);
  return example;
}

TEST(Yaml, DuplicateKeyErrorNamesLine) {
  EXPECT_EQ(parse_error_of("a: 1\nb: 2\na: 3\n"), "a.yaml:3: a: duplicate key; delete one of them");
  EXPECT_THAT(parse_error_of("x:\n  a: 1\n  a: 1\n"), HasSubstr("a.yaml:3"));
}

TEST(Yaml, SyntaxErrorNamesLine) {
  EXPECT_THAT(parse_error_of("a: 1\nb: [1, 2\nc: 3\n"), HasSubstr("a.yaml:3: not valid YAML"));
  EXPECT_THAT(parse_error_of("a: 1\n\tb: 2\n"), HasSubstr("not valid YAML"));
}

TEST(Yaml, RejectsNonScalarKeys) {
  EXPECT_THAT(parse_error_of("[1, 2]: 3"), HasSubstr("a.yaml:1"));
}

TEST(Yaml, RejectsSecondDocument) {
  EXPECT_THAT(parse_error_of("a: 1\n---\nb: 2\n"), HasSubstr("a.yaml"));
  EXPECT_EQ(parse_error_of("---\na: 1\n"), "");
  EXPECT_EQ(parse_error_of("%YAML:1.0\n---\na: 1\n...\n"), "");  // as OpenCV writes it
}

TEST(Yaml, LimitsNestingAndAliases) {
  std::string flow(200, '[');
  EXPECT_NE(parse_error_of(flow.append(std::string(200, ']'))), "");
  EXPECT_NE(parse_error_of(std::string(100000, '[')), "");
  std::string nested_aliases = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n";
  for (int i = 1; i < 12; ++i) {
    const std::string item = fmt::format("*a{}", i - 1);
    nested_aliases +=
        fmt::format("a{0}: &a{0} [{1}, {1}, {1}, {1}, {1}, {1}, {1}, {1}, {1}, {1}]\n", i, item);
  }
  EXPECT_THAT(parse_error_of(nested_aliases), HasSubstr("too large"));
}

TEST(Yaml, StoresSourceLocationOfValues) {
  const Node node = parse_yaml("a:\n  b: [1,\n      2]\n", "a.yaml");
  EXPECT_EQ(node.find("a")->find("b")->items[1].where(), "a.yaml:3");
}

TEST(Files, ErrorNamesMissingFileOrFolder) {
  const test::TmpDir dir;
  EXPECT_THAT(error_of([&] { load_file(dir.path() / "no.yaml"); }), HasSubstr("no.yaml"));
  EXPECT_THAT(error_of([&] { load_file(dir.path()); }), HasSubstr("folder"));
}

TEST(Inheritance, LaterFilesOverrideEarlierOnes) {
  const test::TmpDir dir;
  dir.write("base/a.yaml",
            "seed: 1\nrate_hz: 1\ntracker: {max_features: 100, min_distance_px: 10}\n");
  dir.write("base/b.yaml", "seed: 2\nrate_hz: 2\ntracker: {max_features: 200}\n");
  const auto file =
      dir.write("runs/c.yaml", "inherit: [../base/a.yaml, ../base/b.yaml]\nseed: 3\n");
  const ExampleConfig c = as_example(load_with_inheritance(file));
  EXPECT_EQ(c.seed, 3);
  EXPECT_EQ(c.rate_hz, 2.0);
  EXPECT_EQ(c.tracker.max_features, 200);
  EXPECT_EQ(c.tracker.min_distance_px, 10.0);
}

TEST(Inheritance, PathsAreRelativeToTheInheritingFile) {
  const test::TmpDir dir;
  dir.write("a/deep/x.yaml", "seed: 5\n");
  dir.write("a/mid.yaml", "inherit: deep/x.yaml\nrate_hz: 5\n");
  const auto file = dir.write("top.yaml", "inherit: a/mid.yaml\n");
  const ExampleConfig c = as_example(load_with_inheritance(file));
  EXPECT_EQ(c.seed, 5);
  EXPECT_EQ(c.rate_hz, 5.0);
}

TEST(Inheritance, SearchesFoldersForFilesThatAreNotBesideIt) {
  const test::TmpDir dir;
  dir.write("share/configs/base.yaml", "seed: 1\nrate_hz: 1\n");
  dir.write("share/configs/deep/mid.yaml", "inherit: ../base.yaml\nrate_hz: 2\n");
  const std::vector<std::filesystem::path> search = {dir.path() / "share/configs"};
  const auto load = [&](const char* name) {
    const auto file = dir.write("mine/own.yaml", fmt::format("inherit: {}\n", name));
    return as_example(load_with_inheritance(file, {}, search));
  };
  EXPECT_EQ(load("base.yaml").rate_hz, 1.0);
  EXPECT_EQ(load("configs/base.yaml").rate_hz, 1.0);
  EXPECT_EQ(load("deep/mid.yaml").rate_hz, 2.0);
  EXPECT_EQ(load("configs/deep/mid.yaml").seed, 1);
  EXPECT_EQ(error_of([&] { load("none.yaml"); }),
            fmt::format("{}:1: inherit: no such file: none.yaml (relative to this file, or in {})",
                        (dir.path() / "mine/own.yaml").string(), search.front().string()));
  EXPECT_THAT(error_of([&] { load("configs"); }), HasSubstr("no such file: configs"));
  dir.write("mine/base.yaml", "seed: 9\n");  // the file beside it wins
  EXPECT_EQ(load("base.yaml").seed, 9);
}

TEST(Inheritance, ListsAreReplaced) {
  const test::TmpDir dir;
  dir.write("a.yaml", "weights: [1, 2, 3]\n");
  const auto file = dir.write("b.yaml", "inherit: a.yaml\nweights: [9]\n");
  EXPECT_THAT(as_example(load_with_inheritance(file)).weights, ElementsAre(9.0));
}

TEST(Inheritance, ErrorNamesFileOfTheValue) {
  const test::TmpDir dir;
  const auto parent = dir.write("a.yaml", "\nseed: fast\n");
  const auto file = dir.write("b.yaml", "inherit: a.yaml\nrate_hz: 3\n");
  const std::string what = error_of([&] { as_example(load_with_inheritance(file)); });
  EXPECT_THAT(what, HasSubstr("a.yaml:2: seed:"));
}

TEST(Inheritance, RejectsCycles) {
  const test::TmpDir dir;
  dir.write("a.yaml", "inherit: b.yaml\n");
  const auto file = dir.write("b.yaml", "inherit: a.yaml\n");
  EXPECT_THAT(error_of([&] { load_with_inheritance(file); }), HasSubstr("cycle"));
  const auto self = dir.write("self.yaml", "inherit: ./self.yaml\n");
  EXPECT_THAT(error_of([&] { load_with_inheritance(self); }), HasSubstr("cycle"));
}

TEST(Inheritance, AllowsDiamondInheritance) {
  const test::TmpDir dir;
  dir.write("base.yaml", "seed: 4\n");
  dir.write("a.yaml", "inherit: base.yaml\n");
  dir.write("b.yaml", "inherit: base.yaml\n");
  const auto file = dir.write("c.yaml", "inherit: [a.yaml, b.yaml]\n");
  EXPECT_EQ(as_example(load_with_inheritance(file)).seed, 4);
}

TEST(Inheritance, MissingParentErrorNamesLine) {
  const test::TmpDir dir;
  const auto file = dir.write("c.yaml", "seed: 1\ninherit: nowhere.yaml\n");
  EXPECT_EQ(error_of([&] { load_with_inheritance(file); }),
            fmt::format("{}:2: inherit: no such file: nowhere.yaml (relative to this file)",
                        file.string()));
  const auto wrong = dir.write("d.yaml", "inherit: {a: b}\n");
  EXPECT_THAT(error_of([&] { load_with_inheritance(wrong); }), HasSubstr("expected a file name"));
}

TEST(Overrides, SetNestedValuesAndCreateSections) {
  Node node = parse_yaml("seed: 1\ntracker: {max_features: 100}\n", "a.yaml");
  for (const char* assignment : {"seed=2", "tracker.min_distance_px=7", "spans=[[5, 8]]",
                                 "name=a=b", "cases.x.max_features=33", "limit = 0.5"}) {
    apply_override(node, assignment);
  }
  const ExampleConfig c = as_example(node);
  EXPECT_EQ(c.seed, 2);
  EXPECT_EQ(c.tracker.max_features, 100);
  EXPECT_EQ(c.tracker.min_distance_px, 7.0);
  EXPECT_THAT(c.spans, ElementsAre(ElementsAre(5.0, 8.0)));
  EXPECT_EQ(c.name, "a=b");
  EXPECT_EQ(c.cases.at("x").max_features, 33);
  EXPECT_EQ(c.limit, 0.5);
}

TEST(Overrides, ApplyToEmptyConfiguration) {
  Node node;
  apply_override(node, "tracker.max_features=44");
  EXPECT_EQ(as_example(node).tracker.max_features, 44);
}

TEST(Overrides, ErrorNamesCommandLineOption) {
  Node node = parse_yaml("seed: 1\n", "a.yaml");
  apply_override(node, "tracker.max_features=5");
  EXPECT_EQ(error_of([&] { as_example(node); }),
            "--set: tracker.max_features: 5 is outside [20, 2000]");
  Node other;
  apply_override(other, "tracker.max_fetures=50");
  EXPECT_EQ(error_of([&] { as_example(other); }),
            "--set: unknown key tracker.max_fetures; did you mean tracker.max_features?");
  EXPECT_EQ(error_of([&] { apply_override(other, "a..b=1"); }),
            "--set: a..b: empty key between dots");
  EXPECT_THAT(error_of([&] { apply_override(other, "weights=[1, 2"); }),
              HasSubstr("--set weights:1: not valid YAML"));
}

TEST(Overrides, TextIsLiteral) {
  for (const char* name :
       {"/data/dive #2", "#1", "colon: yes", "[a]/b", "- a", "x: [1", "!a", "*a", "it's", "a=b"}) {
    Node node;
    apply_override(node, std::string("name=") + name);
    EXPECT_EQ(as_example(node).name, name);
  }
  Node node;
  apply_override(node, "name='quoted # text'");
  EXPECT_EQ(as_example(node).name, "quoted # text");
  apply_override(node, "name=");
  EXPECT_EQ(as_example(node).name, "");
}

TEST(Overrides, RejectMissingKeyOrEqualsSign) {
  Node node;
  for (const char* bad : {"seed", "=3", "", "tracker..max_features=3", ".seed=3", "seed.=3"}) {
    EXPECT_NE(error_of([&] { apply_override(node, bad); }), "") << bad;
  }
  EXPECT_NE(error_of([&] { apply_override(node, "weights=[1, 2"); }), "");
}

TEST(Merge, MergesMapsAndReplacesOtherValues) {
  Node base = parse_yaml("a: {x: 1, y: 2}\nb: [1, 2]\nc: 3\n", "base");
  merge(base, parse_yaml("a: {y: 9, z: 8}\nb: [7]\nc: {d: 4}\n", "over"));
  EXPECT_EQ(base.find("a")->find("x")->text, "1");
  EXPECT_EQ(base.find("a")->find("y")->text, "9");
  EXPECT_EQ(base.find("a")->find("z")->text, "8");
  EXPECT_EQ(base.find("b")->items.size(), 1u);
  EXPECT_EQ(base.find("c")->find("d")->text, "4");
}

}  // namespace
}  // namespace apvi::config
