// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag/bag_recording.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <map>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "io/folder/imu_unit.hpp"
#include "io/folder/plausible_source.hpp"
#include "io/folder/vertical_motion.hpp"
#include "io/rosbag/dvl_message.hpp"
#include "io/rosbag/navsat.hpp"
#include "io/rosbag/ros_samples.hpp"

namespace apvi::io {
namespace {

// The recording time is the arrival of a message, its stamp the time of measurement. Messages of
// one topic are reordered within kReorderWindow. Topics wait for each other for at most
// kMaxLookahead, so that memory stays bounded when one sensor stops.
constexpr Duration kReorderWindow{100'000'000};
constexpr Duration kMaxLookahead{2'000'000'000};

constexpr std::size_t kImuSamples = 20'000;  // that tell the unit: minutes

using Problem = std::pair<std::string, std::string>;  // its kind, and the text at fault

struct Channel {
  std::string topic;
  MessageToEvent convert;
};

// Distributes the messages of a bag to per-sensor queues, reading ahead on demand.
class BagDemultiplexer {
 public:
  BagDemultiplexer(const Bag& bag, std::vector<Channel> channels)
      : path_(bag.path),
        channels_(std::move(channels)),
        queues_(channels_.size()),
        cursor_(bag.open(topics_of_channels())) {}

  SourceState next(std::size_t channel, SensorEvent& event) {
    auto& queue = queues_[channel];
    while (!ended_ && (queue.empty() || latest_ - queue.front().recorded < kReorderWindow) &&
           !lookahead_is_full()) {
      read_one();
    }
    if (queue.empty()) return ended_ ? SourceState::end : SourceState::pending;
    Item item = std::move(queue.front());
    queue.pop_front();
    last_[channel] = item.stamp;
    problem_[channel] = std::move(item.problem);
    if (!item.event) return SourceState::malformed;
    event = std::move(*item.event);
    return SourceState::sample;
  }
  std::string where(std::size_t channel) const {
    const auto it = last_.find(channel);
    const double t = it == last_.end() ? 0.0 : it->second.seconds();
    return fmt::format("{}: {} at {:.9f}", path_, channels_[channel].topic, t);
  }
  Problem problem(std::size_t channel) const {
    const auto it = problem_.find(channel);
    return it == problem_.end() ? Problem{} : it->second;
  }
  double fraction() const { return cursor_->fraction(); }

 private:
  struct Item {
    Stamp recorded;
    Stamp stamp;
    std::optional<SensorEvent> event = std::nullopt;  // nullopt when malformed
    Problem problem = {};
  };

  std::set<std::string> topics_of_channels() const {
    std::set<std::string> topics;
    for (const Channel& channel : channels_) topics.insert(channel.topic);
    return topics;
  }

  bool lookahead_is_full() const {
    return std::any_of(queues_.begin(), queues_.end(), [&](const auto& queue) {
      return !queue.empty() && latest_ - queue.front().recorded > kMaxLookahead;
    });
  }

  void read_one() {
    if (!cursor_->advance()) {
      ended_ = true;
      return;
    }
    latest_ = cursor_->recorded();
    const auto message = cursor_->message();
    for (std::size_t i = 0; i < channels_.size(); ++i) {
      if (channels_[i].topic == cursor_->topic())
        insert(queues_[i], convert(channels_[i], message));
    }
  }

  Item convert(const Channel& channel, const std::optional<RosValue>& message) const {
    Item item{cursor_->recorded(), cursor_->recorded()};
    if (!message) item.problem = {"the bytes do not fit the definition of the message", ""};
    if (!message) return item;
    const auto stamp = stamp_of_message(*message, item.recorded);
    if (!stamp) item.problem = {"the stamp is out of range", ""};
    if (!stamp) return item;
    item.stamp = *stamp;
    item.event = channel.convert(*message, *stamp);
    if (!item.event) item.problem = problem_of(*message);
    return item;
  }

  // Inserts by stamp: at the end, unless messages arrived out of order.
  static void insert(std::deque<Item>& queue, Item item) {
    auto place = queue.end();
    while (place != queue.begin() && std::prev(place)->stamp > item.stamp &&
           std::prev(place)->stamp - item.stamp <= kReorderWindow) {
      --place;
    }
    queue.insert(place, std::move(item));
  }

  std::string path_;
  std::vector<Channel> channels_;
  std::vector<std::deque<Item>> queues_;
  std::map<std::size_t, Stamp> last_;  // delivered, of each channel
  std::map<std::size_t, Problem> problem_;
  std::unique_ptr<MessageCursor> cursor_;
  Stamp latest_;
  bool ended_ = false;
};

class BagSource : public SampleSource {
 public:
  BagSource(std::shared_ptr<BagDemultiplexer> demultiplexer, std::size_t channel)
      : demultiplexer_(std::move(demultiplexer)), channel_(channel) {}
  SourceState next(SensorEvent& event) override { return demultiplexer_->next(channel_, event); }
  std::string where() const override { return demultiplexer_->where(channel_); }
  Problem problem() const override { return demultiplexer_->problem(channel_); }
  double fraction() const override { return demultiplexer_->fraction(); }

 private:
  std::shared_ptr<BagDemultiplexer> demultiplexer_;
  std::size_t channel_;
};

// Poses, or the positions of a satellite receiver from its first fix.
class ReferenceReader {
 public:
  std::optional<SE3> pose(const RosValue& message) {
    if (message.find("latitude") == nullptr) return pose_of(message);
    const auto fix = fix_of(message);
    if (!fix) return std::nullopt;
    if (!origin_) origin_ = *fix;
    has_height_ = has_height_ && std::isfinite(fix->altitude_m);
    return SE3{Eigen::Quaterniond::Identity(), east_north_up(*fix, *origin_)};
  }
  bool has_rotation() const { return !origin_; }
  bool has_height() const { return has_height_; }

 private:
  std::optional<GeodeticPosition> origin_;
  bool has_height_ = true;
};

std::optional<Trajectory> read_reference_topic(const Bag& bag, const std::string& topic) {
  const auto cursor = bag.open({topic});
  ReferenceReader reader;
  Trajectory trajectory;
  std::size_t dropped = 0;
  while (cursor->advance()) {
    const auto message = cursor->message();
    const auto stamp = message ? stamp_of_message(*message, cursor->recorded()) : std::nullopt;
    const bool later = stamp && (trajectory.empty() || *stamp > trajectory.poses.back().stamp);
    const auto pose = later ? reader.pose(*message) : std::nullopt;
    if (pose) {
      trajectory.poses.push_back({*stamp, *pose});
    } else {
      ++dropped;
    }
  }
  if (dropped > 0) log::warning("{}: {} unusable poses of {} dropped", bag.path, dropped, topic);
  if (trajectory.empty()) return std::nullopt;
  trajectory.has_rotation = reader.has_rotation();
  trajectory.has_height = reader.has_height();
  return trajectory;
}

struct BagSensor {
  std::string name;    // section of the rig
  std::string kind;    // of the events
  std::string choice;  // name in sensors.use
  std::string topic;
  MessageToEvent convert;
};

// What only the readings themselves tell.
struct Scales {
  ImuFactors imu;
  std::shared_ptr<PressureScale> pressure = std::make_shared<PressureScale>();
};

// Readings of which the units are to be decided.
struct Evidence {
  ImuEvidence imu;
  std::optional<VerticalMotion> motion;
  std::vector<double> pressures;
  std::vector<PressureReading> stamped_pressures;
};

void add_imu(const RosValue& message, Stamp stamp, Evidence& evidence) {
  const auto event = imu_of(message, stamp);
  if (!event) return;
  evidence.imu.add(std::get<ImuSample>(*event));
  if (evidence.motion) evidence.motion->add(std::get<ImuSample>(*event));
}

void add_pressure(const RosValue& message, Stamp stamp, Evidence& evidence) {
  const auto value = message.number_at("fluid_pressure");
  if (!value) return;
  evidence.pressures.push_back(*value);
  if (std::isfinite(*value)) evidence.stamped_pressures.push_back({stamp, *value});
}

// Looks at the beginning for IMU and DVL, which is sufficient, and at the whole bag for the
// pressure.
Scales read_scales(const Bag& bag, const ChosenTopics& from, PressureSource pressure,
                   const config::Node& rig) {
  Scales scales;
  Evidence evidence;
  const auto dvl = dvl_of_rig(rig);
  const bool by_motion = dvl && !from.dvl.empty() && !pressure.name.empty() &&
                         pressure.unit == PressureUnit::automatic;
  if (by_motion) evidence.motion.emplace(*dvl);
  std::set<std::string> topics = {from.imu, pressure.name, by_motion ? from.dvl : ""};
  topics.erase("");
  if (topics.empty()) return scales;
  const auto cursor = bag.open(topics);
  while (cursor->advance()) {
    const bool enough = evidence.imu.magnitudes.count() >= kImuSamples;
    if (enough && pressure.name.empty()) break;
    if (enough && cursor->topic() != pressure.name) continue;
    const auto message = cursor->message();
    if (!message) continue;
    const Stamp stamp = stamp_of_message(*message, cursor->recorded()).value_or(cursor->recorded());
    if (cursor->topic() == from.imu) {
      add_imu(*message, stamp, evidence);
    } else if (cursor->topic() == pressure.name) {
      add_pressure(*message, stamp, evidence);
    } else if (const auto ping = dvl_of(*message, stamp)) {
      evidence.motion->add(std::get<DvlSample>(*ping));
    }
  }
  std::ranges::stable_sort(evidence.stamped_pressures, {}, &PressureReading::stamp);
  if (evidence.motion) {
    pressure.growth_per_meter = evidence.motion->growth_per_meter(evidence.stamped_pressures);
  }
  scales.imu = imu_factors(evidence.imu, {}, from.imu);
  *scales.pressure = evaluate_pressure(std::move(evidence.pressures), pressure);
  return scales;
}

std::vector<BagSensor> sensors_of(const ChosenTopics& topics, const Scales& scales) {
  return {
      {"imu0", "imu", "imu", topics.imu, imu_with(scales.imu)},
      {"dvl0", "dvl", "dvl", topics.dvl, dvl_converter(topics.dvl)},
      {"pressure0", "pressure", "pressure", topics.pressure, pressure_of(*scales.pressure)},
      {"depth0", "depth", "pressure", topics.depth, depth_of},
      {"cam0", "camera", "camera", topics.cam0, image_of(0, topics.cam0)},
      {"cam1", "camera", "camera", topics.cam1, image_of(1, topics.cam1)},
  };
}

// Whether the recording has the sensor and the rig describes it.
bool is_used(const BagSensor& sensor, const config::Node& rig, const std::string& path) {
  const bool described = rig.find(sensor.name) != nullptr;
  if (sensor.topic.empty() && described && sensor.name != "cam1") {
    fail_input(
        "{}: no topic for {}, which the rig describes; set dataset.topics, or remove {} from "
        "sensors.use",
        path, sensor.name, sensor.choice);
  }
  if (sensor.topic.empty()) return false;
  if (sensor.kind != "camera" || rig.is_null() || described) return true;
  log::info("{}: {} ignored: the rig does not describe {}", path, sensor.topic, sensor.name);
  return false;
}

}  // namespace

Recording read_bag(const Bag& bag, const std::filesystem::path& own_rig,
                   const DatasetConfig& config, const SensorChoice& choice) {
  Recording recording;
  recording.rig = load_rig(config, own_rig);
  const ChosenTopics topics = choose_topics(bag.topics, config.topics, bag.path);
  std::vector<Channel> channels;
  std::vector<std::string> kinds;
  ChosenTopics used = topics;
  if (!choice.wants("imu")) used.imu.clear();
  if (!choice.wants("dvl")) used.dvl.clear();
  if (!choice.wants("pressure")) used.pressure.clear();
  const Scales scales = read_scales(bag, used,
                                    {.name = used.pressure,
                                     .unit = config.pressure_unit,
                                     .atmospheric_pa = atmospheric_pressure_pa(recording.rig)},
                                    recording.rig);
  for (BagSensor& sensor : sensors_of(topics, scales)) {
    if (!choice.wants(sensor.choice) || !is_used(sensor, recording.rig, bag.path)) continue;
    channels.push_back({sensor.topic, std::move(sensor.convert)});
    kinds.push_back(sensor.kind);
  }
  if (!channels.empty()) {
    const auto demultiplexer = std::make_shared<BagDemultiplexer>(bag, std::move(channels));
    for (std::size_t i = 0; i < kinds.size(); ++i) {
      std::unique_ptr<SampleSource> source = std::make_unique<BagSource>(demultiplexer, i);
      if (kinds[i] == "pressure")
        source = std::make_unique<PlausibleSource>(std::move(source), scales.pressure);
      recording.add(kinds[i], std::move(source));
    }
  }
  recording.reference = [bag, topic = topics.reference]() -> std::optional<Trajectory> {
    return topic.empty() ? std::nullopt : read_reference_topic(bag, topic);
  };
  return recording;
}

}  // namespace apvi::io
