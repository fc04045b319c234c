// SPDX-License-Identifier: BSD-3-Clause
#include <cstdint>
#include <filesystem>
#include <memory>

#include "cli/commands.hpp"
#include "core/interrupt.hpp"
#include "runs/views/view_run.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  fs::path source;
  viewer::ServerOptions server;
  fs::path file;
  std::int64_t max_gaussians = 1'000'000;
};

void view(const Arguments& a) {
  if (!a.file.empty()) return runs::export_view(a.source, a.file, a.max_gaussians);
  const InterruptGuard guard;
  runs::view_run(a.source, a.server, [&guard] { return guard.interrupted(); });
}

}  // namespace

void add_view(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* command =
      app.add_subcommand("view", "show a map and its trajectory in a browser, from any viewpoint");
  command->add_option("SOURCE", a->source, "run folder, or a map file: .ply or .spz")
      ->type_name("FILE|FOLDER")
      ->required();
  command->add_option("--port", a->server.port, "port of the page (default: 8700); 0: any")
      ->check(CLI::Range(0, 65535))
      ->type_name("N");
  command
      ->add_option("--address", a->server.address,
                   "address to listen on (default: 127.0.0.1, this machine alone); any other one "
                   "demands a token")
      ->type_name("IP");
  command
      ->add_option("--token", a->server.token,
                   "what the address of the page must end with (default: none on this machine "
                   "alone, else a random one)")
      ->type_name("TEXT");
  command->add_option("--export", a->file, "write a page that needs no server, and end")
      ->type_name("FILE");
  command
      ->add_option("--max-gaussians", a->max_gaussians,
                   "with --export: merge neighbors until there are at most so many (default: "
                   "1000000, about 50 MB)")
      ->check(CLI::PositiveNumber)
      ->type_name("N");
  command->footer("Ctrl-C ends it.");
  command->callback([a] { view(*a); });
}

}  // namespace apvi::cli
