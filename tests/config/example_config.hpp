// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "apvi/config/fields.hpp"

namespace apvi::test {

enum class Mode { paper, tight };

struct TrackerConfig {
  int max_features = 150;
  double min_distance_px = 20.0;
  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("max_features", max_features, Range{20, 2000}, "corners kept in a frame");
    v("min_distance_px", min_distance_px, Range{1.0, 200.0}, "spacing between corners [px]");
  }
};

/// One field of every kind.
struct ExampleConfig {
  bool enabled = true;
  int seed = 0;
  double rate_hz = 20.0;
  std::string name = "first";
  Mode mode = Mode::paper;
  TrackerConfig tracker;
  std::optional<double> limit;
  std::optional<TrackerConfig> second;
  std::vector<double> weights{1.0, 2.0};
  std::array<int, 2> size{640, 480};
  std::vector<std::array<double, 2>> spans;
  std::map<std::string, TrackerConfig> cases;
  config::Node raw;

  template <typename V>
  void visit(V& v) {
    using config::Choices;
    using config::Range;
    v("enabled", enabled, "whether it runs");
    v("seed", seed, "of the random numbers");
    v("rate_hz", rate_hz, Range{0.1, 1000.0}, "rate [Hz]");
    v("name", name, "a name");
    v("mode", mode, Choices<Mode>{{"paper", Mode::paper}, {"tight", Mode::tight}}, "which graph");
    v("tracker", tracker, "corner tracking");
    v("limit", limit, Range{0.0, 1.0}, "upper limit");
    v("second", second, "another tracker");
    v("weights", weights, Range{0.0, 10.0}, "weights");
    v("size", size, "width, height [px]");
    v("spans", spans, "from, to [s]");
    v("cases", cases, "named trackers");
    v("raw", raw, "kept as it is");
  }
};

}  // namespace apvi::test
