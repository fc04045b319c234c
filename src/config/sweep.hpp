// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apvi/config/fields.hpp"

namespace apvi::config {

/// Definition of a sweep: the product of all axes and seeds, with the keys of `set` in every case.
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
      "what a case runs: apvi run of a configuration, or apvi sim of a scene");
    v("base", base, "configuration file or list of files, looked for like inherited ones");
    v("set", set, "keys that override them in every case");
    v("cases", cases,
      "named cases, each a set of keys: {full: {}, no_freeze: {freeze.enabled: false}}");
    v("grid", grid,
      "further axes: a key with a list of values, or an axis of named alternatives like cases");
    v("seeds", seeds, "number of seeds (5: 1 to 5) or list of seeds; absent: one run per case");
    v("seed_key", seed_key, "key that is set to the seed (default: run.seed, or seed for a scene)");
    v("columns", columns, "metrics in the table, e.g. trajectory.ate_rmse_m");
  }
};

/// One run of a sweep.
struct SweepCase {
  std::string group;  ///< name shared by all seeds of a case; a valid folder name
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

/// Reads a sweep file and expands its cases. Dotted keys address nested sections; `base` can be an
/// axis too. `search`: folders of inherited and base files, see load_with_inheritance. Throws
/// InputError with file and line.
Sweep load_sweep(const std::filesystem::path& path,
                 const std::vector<std::filesystem::path>& search = {});

}  // namespace apvi::config
