// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <cstddef>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "cli/commands.hpp"
#include "core/text.hpp"
#include "runs/scale_run.hpp"

namespace apvi::cli {
namespace {

struct Arguments {
  runs::ScaleRequest request;
  std::vector<std::string> bars;
  std::vector<std::string> distances;
};

// The words of a comma-separated option.
std::vector<std::string_view> words_of(const char* option, const std::string& text,
                                       std::size_t count, const char* form) {
  std::vector<std::string_view> words;
  text::split(text, ',', words);
  if (words.size() != count) fail_input("{}: {}: expected {}", option, text, form);
  return words;
}

double number_of(const char* option, std::string_view word) {
  const auto value = text::parse_double(text::trim(word));
  if (!value) fail_input("{}: \"{}\" is not a number", option, word);
  return *value;
}

runs::ScaleBar bar_of(const std::string& text) {
  const auto words = words_of("--bar", text, 6, "STAMP,U1,V1,U2,V2,METERS");
  const auto stamp = text::parse_int64(text::trim(words[0]));
  if (!stamp) fail_input("--bar: \"{}\" is not a stamp in nanoseconds", words[0]);
  const auto at = [&](std::size_t i) { return number_of("--bar", words[i]); };
  return {Stamp{*stamp}, {at(1), at(2)}, {at(3), at(4)}, at(5)};
}

runs::KnownDistance distance_of(const std::string& text) {
  const auto words = words_of("--distance", text, 7, "X1,Y1,Z1,X2,Y2,Z2,METERS");
  const auto at = [&](std::size_t i) { return number_of("--distance", words[i]); };
  return {{at(0), at(1), at(2)}, {at(3), at(4), at(5)}, at(6)};
}

void scale(Arguments& a) {
  for (const std::string& text : a.bars) a.request.bars.push_back(bar_of(text));
  for (const std::string& text : a.distances) a.request.distances.push_back(distance_of(text));
  const runs::ScaleResult result = runs::scale_run(a.request);
  log::info("{}: {:.5f} m per unit of {}", a.request.folder.string(), result.meters_per_unit,
            a.request.run.string());
}

}  // namespace

void add_scale(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* command =
      app.add_subcommand("scale", "change the unit of a run to meters, by lengths that are known");
  command->add_option("RUN", a->request.run, "run folder with a map")
      ->type_name("FOLDER")
      ->required();
  command->add_option("-o,--output", a->request.folder, "run folder in meters")
      ->type_name("FOLDER")
      ->required();
  command
      ->add_option("--bar", a->bars,
                   "length between two pixels of an image in renders/: its stamp, the pixels, the "
                   "length; repeatable")
      ->type_name("STAMP,U1,V1,U2,V2,METERS")
      ->allow_extra_args(false);
  command->add_option("--distance", a->distances, "distance of two points of the map; repeatable")
      ->type_name("X1,Y1,Z1,X2,Y2,Z2,METERS")
      ->allow_extra_args(false);
  command->add_option("--factor", a->request.factor, "meters per unit of the run")
      ->check(CLI::PositiveNumber)
      ->type_name("M");
  command->add_flag("--overwrite", a->request.overwrite, "replace an existing run");
  command->footer(
      "For images without a sensor that shows the scale: lay a bar of known length into the "
      "scene.\n"
      "Several bars in several images show how well the lengths agree.");
  command->callback([a] { scale(*a); });
}

}  // namespace apvi::cli
