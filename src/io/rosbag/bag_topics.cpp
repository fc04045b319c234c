// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag/bag_topics.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <string_view>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/text.hpp"

namespace apvi::io {
namespace {

using Words = std::vector<std::string_view>;

// How to find a sensor's topic: the type without package is one of `types`, the name contains one
// of `required` (if any) and none of `excluded`. Of several candidates, the first match in
// `preferred` wins, then the shortest name.
struct Rule {
  std::string_view sensor;
  Words types;
  Words required;
  Words excluded;
  Words preferred;
};

bool contains_any(std::string_view text, const Words& words) {
  return std::any_of(words.begin(), words.end(), [&](std::string_view word) {
    return text.find(word) != std::string_view::npos;
  });
}

std::string_view short_type(std::string_view type) {
  return type.substr(type.find('/') + 1);
}

bool fits(const BagTopic& topic, const Rule& rule) {
  const std::string name = text::to_lower(topic.name);
  const auto type = short_type(topic.type);
  return std::find(rule.types.begin(), rule.types.end(), type) != rule.types.end() &&
         (rule.required.empty() || contains_any(name, rule.required)) &&
         !contains_any(name, rule.excluded);
}

std::size_t rank_of(const BagTopic& topic, const Rule& rule) {
  const std::string name = text::to_lower(topic.name);
  const auto it =
      std::find_if(rule.preferred.begin(), rule.preferred.end(),
                   [&](std::string_view word) { return name.find(word) != std::string::npos; });
  return static_cast<std::size_t>(it - rule.preferred.begin());
}

std::string guess(const std::vector<BagTopic>& topics, const Rule& rule, const std::string& bag) {
  std::vector<const BagTopic*> candidates;
  for (const BagTopic& topic : topics) {
    if (fits(topic, rule)) candidates.push_back(&topic);
  }
  if (candidates.empty()) return "";
  const auto key = [&](const BagTopic* t) {
    return std::tuple(rank_of(*t, rule), t->name.size(), t->name);
  };
  std::sort(candidates.begin(), candidates.end(),
            [&](const BagTopic* a, const BagTopic* b) { return key(a) < key(b); });
  const std::string& chosen = candidates.front()->name;
  const bool tie =
      candidates.size() > 1 && rank_of(*candidates[0], rule) == rank_of(*candidates[1], rule);
  if (tie) {
    log::warning("{}: {} from {}, but {} is equally suitable; set dataset.topics.{} to choose", bag,
                 rule.sensor, chosen, candidates[1]->name, rule.sensor);
  } else {
    log::info("{}: {} from {}", bag, rule.sensor, chosen);
  }
  return chosen;
}

std::string configured(const std::vector<BagTopic>& topics, const std::string& name,
                       std::string_view sensor, const std::string& bag) {
  std::vector<std::string> names;
  for (const BagTopic& topic : topics) {
    if (topic.name == name) return name;
    names.push_back(topic.name);
  }
  fail_input("dataset.topics.{}: there is no topic {} in {}; it has {}", sensor, name, bag,
             fmt::join(names, ", "));
}

const Words kImages = {"Image", "CompressedImage"};
const Words kExcludedImages = {"depth", "disparity", "mask"};

Rule camera_rule(std::string_view sensor, Words required) {
  // Of several versions of an image, prefer the dehazed one, then the lossless one.
  return {sensor,
          kImages,
          std::move(required),
          kExcludedImages,
          {"dehazed", "image_raw", "image_rect"}};
}

}  // namespace

ChosenTopics choose_topics(const std::vector<BagTopic>& topics, const TopicConfig& config,
                           const std::string& bag) {
  const auto choose = [&](const std::string& set, const Rule& rule) {
    return set.empty() ? guess(topics, rule, bag) : configured(topics, set, rule.sensor, bag);
  };
  ChosenTopics chosen;
  chosen.imu = choose(config.imu, {"imu", {"Imu"}, {}, {"mag"}, {"imu/data", "imu0", "imu"}});
  chosen.dvl = choose(
      config.dvl, {"dvl", {"DVL", "Dvl", "BottomTrack"}, {}, {"water_track"}, {"dvl/data", "dvl"}});
  if (chosen.dvl.empty()) {
    chosen.dvl = choose("", {"dvl",
                             {"TwistWithCovarianceStamped", "TwistStamped"},
                             {"dvl"},
                             {"water_track"},
                             {"dvl/data", "dvl"}});
  }
  chosen.pressure = choose(config.pressure, {"pressure", {"FluidPressure"}, {}, {"atmos"}, {}});
  chosen.depth = choose(config.depth, {"depth",
                                       {"Odometry", "PoseWithCovarianceStamped", "PoseStamped"},
                                       {"depth"},
                                       {},
                                       {"depth/data", "depth"}});
  // Other estimates, and ground truth completed by them, are not references.
  chosen.reference = choose(config.reference, {"reference",
                                               {"Odometry", "PoseStamped"},
                                               {"/gt", "truth", "vicon", "mocap", "optitrack"},
                                               {"gt_full", "slam/pose", "depth"},
                                               {"apriltag_slam/gt", "/gt", "truth"}});
  if (chosen.reference.empty()) {
    chosen.reference = choose("", {"reference", {"NavSatFix"}, {}, {}, {}});
  }
  chosen.cam0 = choose(config.cam0, camera_rule("cam0", {"left", "cam0", "camera0"}));
  chosen.cam1 = choose(config.cam1, camera_rule("cam1", {"right", "cam1", "camera1"}));
  if (chosen.cam0.empty() && config.cam0.empty()) {
    chosen.cam0 = choose("", camera_rule("cam0", {}));
    if (chosen.cam0 == chosen.cam1) chosen.cam1.clear();
  }
  return chosen;
}

}  // namespace apvi::io
