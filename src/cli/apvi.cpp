// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <exception>
#include <filesystem>
#include <new>
#include <string>
#include <string_view>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/version.hpp"
#include "cli/commands.hpp"
#include "core/text.hpp"

namespace {

constexpr int kRunFailed = 1;
constexpr int kUsageError = 2;

std::vector<std::string> commands_of(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) {
    names.push_back(command->get_name());
  }
  return names;
}

// CLI11 takes an unknown command for an argument and prints the general help.
void check_command(const CLI::App& app, int argc, char** argv) {
  int i = 1;
  while (i < argc && argv[i][0] == '-' && app.get_option_no_throw(argv[i]) != nullptr) ++i;
  if (i == argc || argv[i][0] == '-') return;
  const std::string name = argv[i];
  const std::vector<std::string> commands = commands_of(app);
  if (std::find(commands.begin(), commands.end(), name) != commands.end()) return;
  const auto guess = apvi::text::closest_match(name, commands);
  apvi::fail_input("unknown command {}; {}", name,
                   guess ? fmt::format("did you mean {}?", *guess)
                         : fmt::format("the commands are {}", fmt::join(commands, ", ")));
}

// Like all messages, those of CLI11 begin in lower case, unless with a name in capitals.
std::string message_of(const CLI::ParseError& error) {
  std::string text = error.what();
  const bool capitalized =
      text.size() > 1 && std::isupper(static_cast<unsigned char>(text[1])) == 0;
  if (capitalized) text[0] = static_cast<char>(std::tolower(static_cast<unsigned char>(text[0])));
  return text;
}

int report(const CLI::App& app, const CLI::ParseError& error) {
  if (error.get_exit_code() == 0) {  // --help, --version
    app.exit(error);
    return 0;
  }
  std::string command = "apvi";
  for (const CLI::App* parsed : app.get_subcommands()) command += " " + parsed->get_name();
  apvi::log::error("{}; see {} --help", message_of(error), command);
  return kUsageError;
}

void add_commands(CLI::App& app) {
  apvi::cli::add_run(app);
  apvi::cli::add_live(app);
  apvi::cli::add_eval(app);
  apvi::cli::add_doctor(app);
  apvi::cli::add_import(app);
  apvi::cli::add_sim(app);
  apvi::cli::add_sweep(app);
  apvi::cli::add_calibrate(app);
  apvi::cli::add_camera(app);
  apvi::cli::add_view(app);
#if APVI_WITH_MAPPING
  apvi::cli::add_render(app);
  apvi::cli::add_export(app);
  apvi::cli::add_merge(app);
  apvi::cli::add_refine(app);
  apvi::cli::add_diff(app);
  apvi::cli::add_scale(app);
#endif
  apvi::cli::add_config(app);
}

std::string version_text() {
  const std::string_view torch = apvi::kLibTorch;
  return fmt::format("apvi {}\ngit revision: {}\nbackend: {}\nmapping: {}", apvi::kVersion,
                     apvi::kGitRevision, apvi::kBackend,
                     torch.empty() ? "off" : fmt::format("on, LibTorch {}", torch));
}

int dispatch(int argc, char** argv) {
  CLI::App app{"Acoustic-pressure-visual-inertial SLAM for underwater robots", "apvi"};
  app.require_subcommand(1);
  app.set_version_flag("--version", version_text());
  app.add_flag_callback(
      "-v,--verbose", [] { apvi::log::set_console_level(apvi::log::Level::debug); },
      "show debug messages");
  app.add_flag_callback(
      "-q,--quiet", [] { apvi::log::set_console_level(apvi::log::Level::warning); },
      "show warnings and errors only");
  app.fallthrough();
  add_commands(app);
  check_command(app, argc, argv);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return report(app, e);
  }
  return 0;
}

// Errors of libraries in the form of the program's own: LibTorch adds where it was called from.
std::string message_of(const std::exception& error) {
  if (const auto* file = dynamic_cast<const std::filesystem::filesystem_error*>(&error)) {
    return fmt::format("{}: {}", file->path1().string(), file->code().message());
  }
  if (dynamic_cast<const std::bad_alloc*>(&error) != nullptr) return "out of memory";
  const std::string text = error.what();
  return std::string(apvi::text::trim(text.substr(0, text.find("\nException raised from"))));
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return dispatch(argc, argv);
  } catch (const apvi::InputError& e) {
    apvi::log::error("{}", e.what());
    return kUsageError;
  } catch (const std::exception& e) {
    apvi::log::error("{}", message_of(e));
    return kRunFailed;
  }
}
