// SPDX-License-Identifier: BSD-3-Clause
#include "runs/refine/refine_plan.hpp"

#include <fmt/format.h>

#include <array>
#include <fstream>
#include <nlohmann/json.hpp>

#include "apvi/core/error.hpp"
#include "core/atomic_file.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr int kVersion = 1;

Json splits_json(const mapping::BlockPartition& partition) {
  Json json = Json::array();
  for (const auto& split : partition.splits()) {
    json.push_back({split.axis, split.value, split.below, split.above});
  }
  return json;
}

mapping::BlockPartition partition_of(const Json& json) {
  std::vector<mapping::BlockPartition::Split> splits;
  for (const Json& split : json) {
    splits.push_back({.axis = split.at(0).get<int>(),
                      .value = split.at(1).get<double>(),
                      .below = split.at(2).get<int>(),
                      .above = split.at(3).get<int>()});
  }
  return mapping::BlockPartition(std::move(splits));
}

Json to_json(const RefinePlan& plan) {
  Json images = Json::array();
  for (const RefineImage& image : plan.images) {
    images.push_back({image.image.ns, image.taken.ns, image.owner});
  }
  Json blocks = Json::array();
  for (const RefineBlock& block : plan.blocks) {
    blocks.push_back({{"images", block.images}, {"neighbors", block.neighbors}});
  }
  return {{"version", kVersion},
          {"run", plan.run.string()},
          {"rounds", plan.rounds},
          {"steps_per_image", plan.steps_per_image},
          {"max_gaussians", plan.max_gaussians},
          {"vignetting", {plan.vignetting.square, plan.vignetting.fourth}},
          {"tone_curve", {plan.tone_curve.gamma, plan.tone_curve.offset}},
          {"origin", plan.origin},
          {"splits", splits_json(plan.partition)},
          {"images", images},
          {"blocks", blocks}};
}

void require(bool valid, const char* what) {
  if (!valid) throw std::runtime_error(what);
}

RefinePlan plan_of(const Json& json) {
  require(json.at("version").get<int>() == kVersion, "made by another version of apvi");
  RefinePlan plan{.run = json.at("run").get<std::string>(),
                  .rounds = json.at("rounds").get<int>(),
                  .steps_per_image = json.at("steps_per_image").get<int>(),
                  .max_gaussians = json.at("max_gaussians").get<int>(),
                  .partition = partition_of(json.at("splits")),
                  .vignetting = {.square = json.at("vignetting").at(0).get<double>(),
                                 .fourth = json.at("vignetting").at(1).get<double>()},
                  .tone_curve = {.gamma = json.at("tone_curve").at(0).get<double>(),
                                 .offset = json.at("tone_curve").at(1).get<double>()},
                  .origin = json.at("origin").get<map_io::Origin>()};
  const auto is_block = [&plan](int i) { return i >= 0 && i < plan.partition.size(); };
  for (const Json& image : json.at("images")) {
    plan.images.push_back({.image = Stamp{image.at(0).get<std::int64_t>()},
                           .taken = Stamp{image.at(1).get<std::int64_t>()},
                           .owner = image.at(2).get<int>()});
    require(is_block(plan.images.back().owner), "an image belongs to no block");
  }
  for (const Json& block : json.at("blocks")) {
    plan.blocks.push_back({.images = block.at("images").get<std::vector<std::size_t>>(),
                           .neighbors = block.at("neighbors").get<std::vector<int>>()});
    for (const std::size_t i : plan.blocks.back().images) {
      require(i < plan.images.size(), "a block has an unknown image");
    }
    for (const int i : plan.blocks.back().neighbors) {
      require(is_block(i), "a block has an unknown neighbor");
    }
  }
  require(plan.rounds > 0 && plan.blocks.size() == static_cast<std::size_t>(plan.partition.size()),
          "the numbers of rounds and blocks do not match");
  return plan;
}

}  // namespace

fs::path refine_folder(const fs::path& folder) {
  return folder / "refine";
}

fs::path plan_file(const fs::path& folder) {
  return refine_folder(folder) / "plan.json";
}

fs::path initial_map_file(const fs::path& folder) {
  return refine_folder(folder) / "initial.ply";
}

fs::path task_file(const fs::path& folder, const RefineTask& task, const char* ending) {
  return refine_folder(folder) /
         fmt::format("round{}_block{}{}", task.round + 1, task.block + 1, ending);
}

fs::path result_file(const fs::path& folder, const RefineTask& task) {
  return task_file(folder, task, ".pt");
}

void write_plan(const fs::path& folder, const RefinePlan& plan) {
  write_file_atomically(plan_file(folder),
                        [&plan](std::ostream& out) { out << to_json(plan).dump(1) << '\n'; });
}

RefinePlan read_plan(const fs::path& folder) {
  const fs::path file = plan_file(folder);
  std::ifstream in(file);
  if (!in) fail_input("{}: missing; {} is no refinement", file.string(), folder.string());
  try {
    return plan_of(Json::parse(in));
  } catch (const std::exception& error) {
    fail_input("{}: {}", file.string(), error.what());
  }
}

}  // namespace apvi::runs
