// SPDX-License-Identifier: BSD-3-Clause
#include "cli/run_support.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>

#include "apvi/core/log.hpp"
#include "eval/metrics_file.hpp"

namespace apvi::cli {

namespace fs = std::filesystem;

fs::path vacant_folder(const std::string& base) {
  fs::path folder = fs::path("runs") / base;
  for (int i = 2; fs::exists(folder); ++i) {
    folder = fs::path("runs") / fmt::format("{}-{}", base, i);
  }
  return folder;
}

void add_overrides(CLI::App& command, std::vector<std::string>& overrides,
                   const std::string& description) {
  command.add_option("--set", overrides, description)
      ->type_name("KEY=VALUE")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
}

void add_view_options(CLI::App& command, ViewOptions& options) {
  command
      .add_flag_function(
          "--view{8700}",
          [&options](std::int64_t port) {
            // CLI11 reads --view=0 as a flag that is off, which is -1.
            options.port = static_cast<int>(std::max<std::int64_t>(0, port));
          },
          "show the map in a browser while it is made; --view=PORT chooses the port, 0 a free one")
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
  command
      .add_option("--view-address", options.address,
                  "address to listen on (default: 127.0.0.1, this machine alone); any other one "
                  "demands a token")
      ->type_name("IP");
}

void report(const runs::RunResult& result) {
  if (result.interrupted) log::warning("interrupted; results so far are saved");
  log::info("{} poses of {:.1f} s in {:.2f} s ({:.1f} times real time)", result.poses,
            result.sequence_s, result.wall_s, result.sequence_s / std::max(1e-9, result.wall_s));
  std::fputs(eval::to_table(result.metrics).c_str(), stdout);
}

}  // namespace apvi::cli
