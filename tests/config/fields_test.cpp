// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/config/fields.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "apvi/core/error.hpp"
#include "config/example_config.hpp"

namespace apvi::config {
namespace {

using test::ExampleConfig;
using test::Mode;
using testing::ElementsAre;
using testing::HasSubstr;

ExampleConfig read_text(const std::string& yaml) {
  ExampleConfig example;
  read(parse_yaml(yaml, "a.yaml"), example);
  return example;
}

// The error message of reading, or "" on success.
std::string error_of(const std::string& yaml) {
  try {
    read_text(yaml);
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

TEST(Fields, AbsentKeysKeepDefaults) {
  for (const char* yaml : {"", "{}", "# nothing\n", "tracker:\n"}) {
    const ExampleConfig c = read_text(yaml);
    EXPECT_EQ(c.name, "first");
    EXPECT_EQ(c.tracker.max_features, 150);
    EXPECT_FALSE(c.limit);
    EXPECT_THAT(c.weights, ElementsAre(1.0, 2.0));
  }
}

TEST(Fields, ReadsEveryFieldType) {
  const ExampleConfig c = read_text(R"(
enabled: no
seed: -3
rate_hz: 1e2
name: "a: b"
mode: tight
tracker: {max_features: 200}
limit: 0.5
second: {min_distance_px: 5}
weights: [3]
size: [320, 240]
spans: [[5, 8], [10, 11.5]]
cases: {a: {max_features: 20}, b: {}}
raw: {anything: [1, {x: y}]}
)");
  EXPECT_FALSE(c.enabled);
  EXPECT_EQ(c.seed, -3);
  EXPECT_EQ(c.rate_hz, 100.0);
  EXPECT_EQ(c.name, "a: b");
  EXPECT_EQ(c.mode, Mode::tight);
  EXPECT_EQ(c.tracker.max_features, 200);
  EXPECT_EQ(c.tracker.min_distance_px, 20.0);
  EXPECT_EQ(c.limit, 0.5);
  ASSERT_TRUE(c.second);
  EXPECT_EQ(c.second->max_features, 150);
  EXPECT_EQ(c.second->min_distance_px, 5.0);
  EXPECT_THAT(c.weights, ElementsAre(3.0));
  EXPECT_THAT(c.size, ElementsAre(320, 240));
  EXPECT_THAT(c.spans, ElementsAre(ElementsAre(5.0, 8.0), ElementsAre(10.0, 11.5)));
  EXPECT_EQ(c.cases.at("a").max_features, 20);
  EXPECT_EQ(c.cases.at("b").max_features, 150);
  EXPECT_EQ(c.raw.find("anything")->items.size(), 2u);
}

struct Third {
  double value = 1.0 / 3.0;
  template <typename V>
  void visit(V& v) {
    v("value", value, Range{0.0, 1.0}, "a third");
  }
};

TEST(Fields, LongDefaultsAreShortInDocumentationAndExactInFiles) {
  EXPECT_EQ(document(Third{}).at(0).default_value, "0.3333");
  EXPECT_EQ(std::stod(to_node(Third{}).find("value")->text), 1.0 / 3.0);
}

TEST(Fields, UnknownKeyErrorNamesLineAndSuggestion) {
  EXPECT_EQ(error_of("seed: 1\ntracker:\n  min_distnce_px: 3\n"),
            "a.yaml:3: unknown key tracker.min_distnce_px; did you mean tracker.min_distance_px?");
  EXPECT_THAT(error_of("seed: 1\nzzz: 3\n"),
              HasSubstr("a.yaml:2: unknown key zzz; known here: enabled,"));
  EXPECT_THAT(error_of("nmae:\n"), HasSubstr("a.yaml:1: unknown key nmae; did you mean name?"));
  EXPECT_THAT(error_of("cases: {a: {max_fetures: 3}}"), HasSubstr("cases.a.max_fetures"));
}

TEST(Fields, WrongTypeErrorNamesExpectedType) {
  EXPECT_EQ(error_of("seed: fast"), "a.yaml:1: seed: expected a whole number, got fast");
  EXPECT_EQ(error_of("\nseed: 1.5"), "a.yaml:2: seed: expected a whole number, got 1.5");
  EXPECT_EQ(error_of("seed: 3000000000"),
            "a.yaml:1: seed: expected a whole number, got 3000000000");
  EXPECT_EQ(error_of("rate_hz: 20Hz"), "a.yaml:1: rate_hz: expected a number, got 20Hz");
  EXPECT_EQ(error_of("enabled: 1"), "a.yaml:1: enabled: expected true or false, got 1");
  EXPECT_EQ(error_of("seed: [1]"), "a.yaml:1: seed: expected a whole number");
  EXPECT_EQ(error_of("name: {a: b}"), "a.yaml:1: name: expected a string");
  EXPECT_EQ(error_of("tracker: 3"), "a.yaml:1: tracker: expected nested keys");
  EXPECT_EQ(error_of("cases: [1]"), "a.yaml:1: cases: expected nested keys");
  EXPECT_EQ(error_of("weights: 3"), "a.yaml:1: weights: expected a list, such as [1, 2, 3]");
  EXPECT_EQ(error_of("size: [1, 2, 3]"), "a.yaml:1: size: expected 2 values, got 3");
  EXPECT_EQ(error_of("spans: [[1, 2], [3]]"), "a.yaml:1: spans[1]: expected 2 values, got 1");
  EXPECT_EQ(error_of("weights: [1, x]"), "a.yaml:1: weights[1]: expected a number, got x");
  EXPECT_THAT(error_of("[1, 2]"), HasSubstr("expected nested keys"));
}

TEST(Fields, RejectsNonFiniteNumbers) {
  for (const char* word : {"nan", ".nan", "inf", "-inf", ".inf"}) {
    EXPECT_NE(error_of(std::string("rate_hz: ").append(word)), "") << word;
  }
}

TEST(Fields, OutOfRangeErrorNamesRange) {
  EXPECT_EQ(error_of("tracker:\n  max_features: 5\n"),
            "a.yaml:2: tracker.max_features: 5 is outside [20, 2000]");
  EXPECT_EQ(error_of("rate_hz: 1000.5"), "a.yaml:1: rate_hz: 1000.5 is outside [0.1, 1000]");
  EXPECT_EQ(error_of("limit: -0.1"), "a.yaml:1: limit: -0.1 is outside [0, 1]");
  EXPECT_EQ(error_of("weights: [1, 11]"), "a.yaml:1: weights[1]: 11 is outside [0, 10]");
  EXPECT_EQ(error_of("tracker: {max_features: 20}"), "");
  EXPECT_EQ(error_of("tracker: {max_features: 2000}"), "");
}

TEST(Fields, UnknownEnumNameErrorListsChoices) {
  EXPECT_EQ(error_of("mode: lose"), "a.yaml:1: mode: lose is none of: paper, tight");
  EXPECT_NE(error_of("mode:\n"), "");
}

TEST(Fields, NullResetsOptional) {
  ExampleConfig c;
  c.limit = 0.3;
  c.second.emplace();
  read(parse_yaml("limit: null\nsecond: ~\n", "a.yaml"), c);
  EXPECT_FALSE(c.limit);
  EXPECT_FALSE(c.second);
}

TEST(Fields, RoundTripsThroughYaml) {
  ExampleConfig c = read_text(R"(
enabled: false
seed: 7
rate_hz: 0.30000000000000004
mode: tight
limit: 0.1
second: {max_features: 30}
weights: []
spans: [[5, 8]]
cases: {a: {max_features: 20}}
raw: {x: [1, {y: "007"}]}
)");
  for (const char* name :
       {"",         "null", "~", "true", "1.5",  "007",        "a: b",       "# c",
        " spaced ", "[x",   "{", "- a",  "it's", "\"quoted\"", "two\nlines", "&a",
        "*a",       "!t",   "@", "%",    "50%",  "=",          "Grün"}) {
    SCOPED_TRACE(name);
    c.name = name;
    ExampleConfig back;
    read(parse_yaml(to_yaml(to_node(c)), "resolved.yaml"), back);
    EXPECT_EQ(back.name, c.name);
    EXPECT_EQ(back.rate_hz, c.rate_hz);
    EXPECT_EQ(back.mode, Mode::tight);
    EXPECT_EQ(back.limit, c.limit);
    EXPECT_EQ(back.second->max_features, 30);
    EXPECT_TRUE(back.weights.empty());
    EXPECT_EQ(back.spans, c.spans);
    EXPECT_EQ(back.cases.at("a").max_features, 20);
    EXPECT_EQ(to_yaml(to_node(back)), to_yaml(to_node(c)));
  }
}

TEST(Fields, DefaultsRoundTrip) {
  ExampleConfig back;
  back.seed = 99;
  back.limit = 0.9;
  read(parse_yaml(to_yaml(to_node(ExampleConfig{})), "resolved.yaml"), back);
  EXPECT_EQ(to_yaml(to_node(back)), to_yaml(to_node(ExampleConfig{})));
}

FieldDoc doc_of(const std::string& key) {
  for (const FieldDoc& row : document(ExampleConfig{})) {
    if (row.key == key) return row;
  }
  ADD_FAILURE() << "no documentation of " << key;
  return {};
}

TEST(Documentation, ListsTypeDefaultRangeAndDescription) {
  const FieldDoc features = doc_of("tracker.max_features");
  EXPECT_EQ(features.type, "int");
  EXPECT_EQ(features.default_value, "150");
  EXPECT_EQ(features.range, "[20, 2000]");
  EXPECT_EQ(features.doc, "corners kept in a frame");
  EXPECT_EQ(doc_of("enabled").default_value, "true");
  EXPECT_EQ(doc_of("mode").type, "enum");
  EXPECT_EQ(doc_of("mode").default_value, "paper");
  EXPECT_THAT(doc_of("mode").range, HasSubstr("tight"));
  EXPECT_EQ(doc_of("limit").type, "number or null");
  EXPECT_EQ(doc_of("limit").default_value, "null");
  EXPECT_EQ(doc_of("weights").default_value, "[1, 2]");
  EXPECT_EQ(doc_of("size").type, "list of int");
  EXPECT_EQ(doc_of("tracker").type, "section");
  EXPECT_EQ(doc_of("second.max_features").default_value, "150");  // also of an absent section
}

TEST(Documentation, MarkdownHasOneLinePerRow) {
  const auto rows = document(ExampleConfig{});
  const std::string table = to_markdown(rows);
  EXPECT_EQ(static_cast<std::size_t>(std::count(table.begin(), table.end(), '\n')),
            rows.size() + 2);
  EXPECT_THAT(table,
              HasSubstr("| `tracker.max_features` | int | `150` | [20, 2000] | corners kept"));
}

}  // namespace
}  // namespace apvi::config
