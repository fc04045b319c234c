// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>
#include <exception>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/version.hpp"
#include "cli/commands.hpp"

namespace {

constexpr int kRunFailed = 1;
constexpr int kUsageError = 2;

int dispatch(int argc, char** argv) {
  CLI::App app{"Acoustic-pressure-visual-inertial SLAM for underwater robots", "apvi"};
  app.require_subcommand(1);
  app.set_version_flag("--version", std::string("apvi ") + apvi::kVersion);
  app.add_flag_callback(
      "-v,--verbose", [] { apvi::log::set_console_level(apvi::log::Level::debug); },
      "show debug messages");
  app.add_flag_callback(
      "-q,--quiet", [] { apvi::log::set_console_level(apvi::log::Level::warning); },
      "show warnings and errors only");
  app.fallthrough();
  apvi::cli::add_run(app);
  apvi::cli::add_eval(app);
  apvi::cli::add_doctor(app);
  apvi::cli::add_import(app);
  apvi::cli::add_sim(app);
  apvi::cli::add_sweep(app);
  apvi::cli::add_calibrate(app);
#if APVI_WITH_MAPPING
  apvi::cli::add_render(app);
  apvi::cli::add_export(app);
#endif
  apvi::cli::add_config(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    const bool asked_for = e.get_exit_code() == 0;  // --help, --version
    app.exit(e);
    return asked_for ? 0 : kUsageError;
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return dispatch(argc, argv);
  } catch (const apvi::InputError& e) {
    apvi::log::error("{}", e.what());
    return kUsageError;
  } catch (const std::exception& e) {
    apvi::log::error("{}", e.what());
    return kRunFailed;
  }
}
