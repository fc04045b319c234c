// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <map>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "io/rosbag/bag_check.hpp"
#include "io/rosbag/bag_recording.hpp"
#include "io/rosbag/rosbag_access.hpp"

namespace apvi::io {
namespace {

namespace fs = std::filesystem;

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
class BagCursor : public MessageCursor {
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

  bool advance() override {
    if (ended_) return false;
    run_guarded([&] {
      if (started_) ++next_;
      started_ = true;
      ended_ = next_ == view_.end();
      if (!ended_) load();
    });
    return !ended_;
  }

  const std::string& topic() const override { return topic_; }
  Stamp recorded() const override { return recorded_; }
  std::optional<RosValue> message() const override {
    return type_ == nullptr ? std::nullopt : type_->decode(bytes_);
  }
  double fraction() const override {
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

}  // namespace

Recording open_bag(const fs::path& path, const DatasetConfig& config, const SensorChoice& choice) {
  const std::string file = path.string();
  try {
    const auto bag = open_file(file);
    check_bag(path);
    const auto open = [file](const std::set<std::string>& topics) {
      return std::make_unique<BagCursor>(file, topics);
    };
    return read_bag({file, topics_of(*bag), open}, path.parent_path() / "rig.yaml", config, choice);
  } catch (const ros::Exception& e) {
    fail_input("{}: cannot read this bag: {}; it may be damaged", path.string(), e.what());
  }
}

}  // namespace apvi::io
