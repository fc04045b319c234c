// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>

/// The subcommands of `apvi`. Each `add_*` declares a subcommand and its arguments; CLI11 runs its
/// callback when selected. The callback throws InputError (exit status 2) or RunError (status 1).
namespace apvi::cli {

void add_run(CLI::App& app);
void add_live(CLI::App& app);
void add_eval(CLI::App& app);
void add_doctor(CLI::App& app);
void add_config(CLI::App& app);
void add_sim(CLI::App& app);
void add_sweep(CLI::App& app);
void add_calibrate(CLI::App& app);
void add_camera(CLI::App& app);
void add_import(CLI::App& app);
/// In a build without mapping, a command that says so.
void add_view(CLI::App& app);
/// Only in builds with mapping.
void add_render(CLI::App& app);
void add_export(CLI::App& app);
void add_merge(CLI::App& app);
void add_refine(CLI::App& app);
void add_diff(CLI::App& app);
void add_scale(CLI::App& app);

}  // namespace apvi::cli
