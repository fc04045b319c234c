// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <deque>
#include <map>
#include <set>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "io/readers.hpp"
#include "io/rosbag/bag_check.hpp"
#include "io/rosbag/bag_topics.hpp"
#include "io/rosbag/ros_samples.hpp"
#include "io/rosbag/rosbag_access.hpp"

namespace apvi::io {
namespace {

namespace fs = std::filesystem;

// The recording time is the arrival of a message, its stamp the time of measurement. Messages of
// one topic are reordered within kReorderWindow. Topics wait for each other for at most
// kMaxLookahead, so that memory stays bounded when one sensor stops.
constexpr Duration kReorderWindow{100'000'000};
constexpr Duration kMaxLookahead{2'000'000'000};

constexpr std::uint64_t kMaxMessage = 64ULL << 20U;  // bytes: fits an image of 20 megapixels

Stamp to_stamp(const ros::Time& time) {
  return {std::int64_t{time.sec} * 1'000'000'000 + time.nsec};
}

std::unique_ptr<rosbag::Bag> open_file(const std::string& path) {
  auto bag = std::make_unique<rosbag::Bag>();
  try {
    bag->open(path, rosbag::bagmode::Read);
  } catch (const rosbag::BagUnindexedException&) {
    fail_input(
        "{}: the bag has no index because its recording was interrupted; run \"rosbag reindex\"",
        path);
  } catch (const std::exception& e) {
    fail_input("{}: cannot read this bag: {}; check that it is a complete ROS1 bag", path,
               explain(e));
  }
  return bag;
}

std::vector<BagTopic> topics_of(const rosbag::Bag& bag) {
  rosbag::View view(bag);
  std::map<std::string, BagTopic> topics;
  for (const rosbag::ConnectionInfo* connection : view.getConnections()) {
    topics[connection->topic] = {connection->topic, connection->datatype, connection->msg_def};
  }
  std::vector<BagTopic> list;
  for (auto& [name, topic] : topics) list.push_back(std::move(topic));
  return list;
}

// Iterates over the messages of selected topics in recording order.
class BagCursor {
 public:
  BagCursor(const std::string& path, const std::set<std::string>& topics)
      : path_(path), bag_(open_file(path)), view_(*bag_, [topics](const rosbag::ConnectionInfo* c) {
          return topics.contains(c->topic);
        }) {
    for (const rosbag::ConnectionInfo* c : view_.getConnections()) {
      types_.try_emplace(c->datatype + c->md5sum, c->datatype, c->msg_def);
    }
    largest_message_ = std::min(kMaxMessage, bag_->getSize() + (1U << 20U));
    run_guarded([&] {
      begin_ = to_stamp(view_.getBeginTime());
      end_ = to_stamp(view_.getEndTime());
      next_ = view_.begin();
    });
  }

  // Advances to the next message; false at the end, or where the bag is damaged.
  bool advance() {
    if (ended_) return false;
    run_guarded([&] {
      if (started_) ++next_;
      started_ = true;
      ended_ = next_ == view_.end();
      if (!ended_) load();
    });
    return !ended_;
  }

  const std::string& topic() const { return topic_; }
  Stamp recorded() const { return recorded_; }
  /// The message, a view into this cursor; nullopt when its bytes do not match its definition.
  std::optional<RosValue> message() const {
    return type_ == nullptr ? std::nullopt : type_->decode(bytes_);
  }
  double fraction() const {
    if (ended_ || end_ <= begin_) return 1.0;
    return std::clamp(seconds_between(begin_, recorded_) / seconds_between(begin_, end_), 0.0, 1.0);
  }

 private:
  void load() {
    const rosbag::MessageInstance& instance = *next_;
    topic_ = instance.getTopic();
    recorded_ = to_stamp(instance.getTime());
    type_ = nullptr;
    // rosbag does not check this size and would copy from beyond its buffer.
    if (instance.size() > largest_message_) return;
    bytes_.resize(instance.size());
    ros::serialization::OStream stream(bytes_.data(), static_cast<std::uint32_t>(bytes_.size()));
    instance.write(stream);
    type_ = &types_.at(instance.getDataType() + instance.getMD5Sum());
  }

  // rosbag throws various exceptions for damaged files. Messages read so far are kept.
  template <typename F>
  void run_guarded(F&& f) {
    try {
      f();
    } catch (const InputError&) {
      throw;
    } catch (const std::exception& e) {
      ended_ = true;
      log::warning("{}: the bag is damaged after {:.3f} s: {}; ignoring the rest", path_,
                   seconds_between(begin_, recorded_), e.what());
    }
  }

  std::string path_;
  std::unique_ptr<rosbag::Bag> bag_;
  rosbag::View view_;
  rosbag::View::iterator next_;
  std::map<std::string, RosMessageType> types_;  // by name and checksum
  bool started_ = false;
  bool ended_ = false;
  Stamp begin_;
  Stamp end_;
  Stamp recorded_;
  std::string topic_;
  std::uint64_t largest_message_ = 0;
  std::vector<std::uint8_t> bytes_;
  const RosMessageType* type_ = nullptr;  // of the message; null when it is damaged
};

struct Channel {
  std::string topic;
  MessageToEvent convert;
};

// Distributes the messages of a bag to per-sensor queues, reading ahead on demand.
class BagDemultiplexer {
 public:
  BagDemultiplexer(const std::string& path, std::vector<Channel> channels)
      : path_(path),
        channels_(std::move(channels)),
        queues_(channels_.size()),
        cursor_(path, topics_of_channels()) {}

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
    if (!item.event) return SourceState::malformed;
    event = std::move(*item.event);
    return SourceState::sample;
  }
  std::string where(std::size_t channel) const {
    const auto it = last_.find(channel);
    const double t = it == last_.end() ? 0.0 : it->second.seconds();
    return fmt::format("{}: {} at {:.9f}", path_, channels_[channel].topic, t);
  }
  double fraction() const { return cursor_.fraction(); }

 private:
  struct Item {
    Stamp recorded;
    Stamp stamp;
    std::optional<SensorEvent> event;  // nullopt when malformed
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
    if (!cursor_.advance()) {
      ended_ = true;
      return;
    }
    latest_ = cursor_.recorded();
    const auto message = cursor_.message();
    for (std::size_t i = 0; i < channels_.size(); ++i) {
      if (channels_[i].topic == cursor_.topic()) insert(queues_[i], convert(channels_[i], message));
    }
  }

  Item convert(const Channel& channel, const std::optional<RosValue>& message) const {
    Item item{cursor_.recorded(), cursor_.recorded(), std::nullopt};
    const auto stamp = message ? stamp_of_message(*message, item.recorded) : std::nullopt;
    if (!stamp) return item;
    item.stamp = *stamp;
    item.event = channel.convert(*message, *stamp);
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
  BagCursor cursor_;
  Stamp latest_;
  bool ended_ = false;
};

class BagSource : public SampleSource {
 public:
  BagSource(std::shared_ptr<BagDemultiplexer> demultiplexer, std::size_t channel)
      : demultiplexer_(std::move(demultiplexer)), channel_(channel) {}
  SourceState next(SensorEvent& event) override { return demultiplexer_->next(channel_, event); }
  std::string where() const override { return demultiplexer_->where(channel_); }
  double fraction() const override { return demultiplexer_->fraction(); }

 private:
  std::shared_ptr<BagDemultiplexer> demultiplexer_;
  std::size_t channel_;
};

std::optional<Trajectory> read_reference_topic(const std::string& path, const std::string& topic) {
  BagCursor cursor(path, {topic});
  Trajectory trajectory;
  std::size_t dropped = 0;
  while (cursor.advance()) {
    const auto message = cursor.message();
    const auto stamp = message ? stamp_of_message(*message, cursor.recorded()) : std::nullopt;
    const auto pose = stamp ? pose_of(*message) : std::nullopt;
    if (pose && (trajectory.empty() || *stamp > trajectory.poses.back().stamp)) {
      trajectory.poses.push_back({*stamp, *pose});
    } else {
      ++dropped;
    }
  }
  if (dropped > 0) log::warning("{}: {} unusable poses of {} dropped", path, dropped, topic);
  if (trajectory.empty()) return std::nullopt;
  return trajectory;
}

struct BagSensor {
  std::string name;    // section of the rig
  std::string kind;    // of the events
  std::string choice;  // name in sensors.use
  std::string topic;
  MessageToEvent convert;
};

std::vector<BagSensor> sensors_of(const ChosenTopics& topics, PressureUnit unit) {
  return {
      {"imu0", "imu", "imu", topics.imu, imu_of},
      {"dvl0", "dvl", "dvl", topics.dvl, dvl_of},
      {"pressure0", "pressure", "pressure", topics.pressure, pressure_of(unit, topics.pressure)},
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

Recording open_topics(const fs::path& path, const DatasetConfig& config,
                      const SensorChoice& choice) {
  const std::string file = path.string();
  Recording recording;
  recording.rig = load_rig(config, path.parent_path() / "rig.yaml");
  const auto bag = open_file(file);
  check_bag(path);
  const ChosenTopics topics = choose_topics(topics_of(*bag), config.topics, file);
  std::vector<Channel> channels;
  std::vector<std::string> kinds;
  for (BagSensor& sensor : sensors_of(topics, config.pressure_unit)) {
    if (!choice.wants(sensor.choice) || !is_used(sensor, recording.rig, file)) continue;
    channels.push_back({sensor.topic, std::move(sensor.convert)});
    kinds.push_back(sensor.kind);
  }
  if (!channels.empty()) {
    const auto demultiplexer = std::make_shared<BagDemultiplexer>(file, std::move(channels));
    for (std::size_t i = 0; i < kinds.size(); ++i) {
      recording.add(kinds[i], std::make_unique<BagSource>(demultiplexer, i));
    }
  }
  recording.reference = [file, topic = topics.reference]() -> std::optional<Trajectory> {
    return topic.empty() ? std::nullopt : read_reference_topic(file, topic);
  };
  return recording;
}

}  // namespace

Recording open_bag(const fs::path& path, const DatasetConfig& config, const SensorChoice& choice) {
  try {
    return open_topics(path, config, choice);
  } catch (const ros::Exception& e) {
    fail_input("{}: cannot read this bag: {}; it may be damaged", path.string(), e.what());
  }
}

}  // namespace apvi::io
