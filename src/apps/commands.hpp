// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>

/// The subcommands of `apvi`. Each `add_*` declares its arguments on the app; when the user chose
/// it, CLI11 calls its body, which throws InputError (status 2), RunError (status 1), or returns.
namespace apvi::apps {

void add_run(CLI::App& app);
void add_eval(CLI::App& app);
void add_doctor(CLI::App& app);
void add_config(CLI::App& app);
void add_sim(CLI::App& app);
void add_sweep(CLI::App& app);
void add_calibrate(CLI::App& app);
/// In builds with the mapping half.
void add_render(CLI::App& app);
void add_export(CLI::App& app);

}  // namespace apvi::apps
