// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apvi/config/fields.hpp"

namespace apvi::config {

/// A file that names many runs: everything in `set`, times every alternative of every axis, times
/// every seed.
struct SweepFile {
  enum class Command { run, sim };

  Command command = Command::run;
  Node base;
  Node set;
  Node cases;
  Node grid;
  Node seeds;
  std::string seed_key;
  std::vector<std::string> columns;

  template <typename V>
  void visit(V& v) {
    v("command", command, Choices<Command>{{"run", Command::run}, {"sim", Command::sim}},
      "what a case is: `apvi run` of a configuration, `apvi sim` of a scene");
    v("base", base, "configuration file, or a list of them, relative to the sweep file");
    v("set", set, "keys laid over it in every case");
    v("cases", cases,
      "alternatives by name, each some keys: {full: {}, blind: {vio.enabled: false}}");
    v("grid", grid,
      "more axes: a key with a list of values, or an axis of named alternatives like `cases`");
    v("seeds", seeds, "how many (5: 1 to 5), or a list; none: every case once");
    v("seed_key", seed_key, "key that they go to (default: run.seed, or seed of a scene)");
    v("columns", columns, "metrics of the table, like trajectory.ate_rmse_m");
  }
};

/// One run of a sweep.
struct SweepCase {
  std::string group;  ///< of the same case with other seeds; fit for a folder's name
  std::vector<std::pair<std::string, std::string>> choices;  ///< axis and alternative
  std::optional<int> seed;
  Node config;  ///< complete: `inherit` with absolute paths, and the case's own keys

  /// `group`, or `group/seed-N`.
  std::filesystem::path folder() const;
};

struct Sweep {
  SweepFile file;
  std::vector<SweepCase> cases;
};

/// Reads a sweep file and makes its cases. Dotted keys reach into sections; `base` is an axis too
/// where an alternative names one. Throws InputError with file and line.
Sweep load_sweep(const std::filesystem::path& path);

}  // namespace apvi::config
