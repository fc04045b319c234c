// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag2/block_cursor.hpp"

#include <algorithm>
#include <map>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "io/rosbag2/decompress.hpp"

namespace apvi::io {
namespace {

// Blocks overlap by a few messages. Where all of them overlap, order yields to memory.
constexpr std::size_t kMaxOpenBytes = 512U << 20U;

struct Pending {
  const BagFile* file = nullptr;
  std::size_t block = 0;
  BagFile::Span span;
};

struct Open {
  const BagFile* file = nullptr;
  std::unique_ptr<BagBlock> block;
  BagMessage message;
};

class BlockCursor : public MessageCursor {
 public:
  BlockCursor(const std::string& path, const BagFiles& files, const std::set<std::string>& topics)
      : path_(path), files_(files), topics_(topics) {
    for (const auto& file : files_) {
      add_types(*file);
      for (std::size_t i = 0; i < file->blocks().size(); ++i) {
        pending_.push_back({file.get(), i, file->blocks()[i]});
      }
    }
    if (pending_.empty()) return;
    std::stable_sort(pending_.begin(), pending_.end(), [](const Pending& a, const Pending& b) {
      return a.span.start < b.span.start;
    });
    begin_ = pending_.front().span.start;
    for (const Pending& p : pending_) end_ = std::max(end_, p.span.end);
  }

  bool advance() override {
    if (current_ < open_.size()) step(current_);
    open_blocks();
    const auto first = earliest();
    current_ = static_cast<std::size_t>(first - open_.begin());
    if (first == open_.end()) return false;
    recorded_ = first->message.recorded;
    decompress();
    return true;
  }

  const std::string& topic() const override { return open_[current_].message.stream->topic; }
  Stamp recorded() const override { return recorded_; }
  std::optional<RosValue> message() const override {
    for (const RosMessageType& type : types_.at(open_[current_].message.stream)) {
      if (auto value = type.decode(bytes_)) return value;
    }
    return std::nullopt;
  }
  double fraction() const override {
    if (current_ >= open_.size() && next_ == pending_.size()) return 1.0;
    if (end_ <= begin_) return 0.0;
    return std::clamp(seconds_between(begin_, recorded_) / seconds_between(begin_, end_), 0.0, 1.0);
  }

 private:
  void add_types(const BagFile& file) {
    for (const BagStream& stream : file.streams()) {
      if (!topics_.contains(stream.topic)) continue;
      auto& types = types_[&stream];
      if (!stream.problem.empty()) continue;  // all its messages are malformed
      for (const std::string& definition : stream.definitions) add_type(stream, definition, types);
    }
  }

  void add_type(const BagStream& stream, const std::string& definition,
                std::vector<RosMessageType>& types) const {
    try {
      types.emplace_back(stream.type, definition, stream.wire);
    } catch (const InputError& e) {
      fail_input("{}: topic {}: {}", path_, stream.topic, e.what());
    }
  }

  // Messages of a damaged file that follow the damage are not read.
  void step(std::size_t i) {
    Open& open = open_[i];
    if (open.block->next(open.message)) return;
    if (open.block->damaged()) forget(open.file);
    open_.erase(open_.begin() + static_cast<std::ptrdiff_t>(i));
  }
  void forget(const BagFile* file) {
    const auto rest = pending_.begin() + static_cast<std::ptrdiff_t>(next_);
    pending_.erase(
        std::remove_if(rest, pending_.end(), [&](const Pending& p) { return p.file == file; }),
        pending_.end());
  }

  std::vector<Open>::iterator earliest() {
    return std::min_element(open_.begin(), open_.end(), [](const Open& a, const Open& b) {
      return a.message.recorded < b.message.recorded;
    });
  }

  // Opens every block that may contain the next message.
  void open_blocks() {
    while (next_ < pending_.size()) {
      const auto first = earliest();
      const bool needed =
          first == open_.end() || pending_[next_].span.start <= first->message.recorded;
      if (!needed || (first != open_.end() && is_full())) return;
      const Pending next = pending_[next_++];
      auto block = next.file->open(next.block, topics_);
      if (block == nullptr) continue;
      open_.push_back({next.file, std::move(block), {}});
      if (open_.back().block->damaged()) forget(next.file);
      step(open_.size() - 1);
    }
  }
  bool is_full() {
    std::size_t bytes = 0;
    for (const Open& open : open_) bytes += open.block->memory();
    if (bytes > kMaxOpenBytes && !std::exchange(warned_, true)) {
      log::warning("{}: too many chunks overlap in time; messages may be out of order", path_);
    }
    return bytes > kMaxOpenBytes;
  }

  // rosbag2 can compress each message.
  void decompress() {
    bytes_ = open_[current_].message.bytes;
    if (!is_zstd(bytes_)) return;
    Decompressed result = decompress_zstd(bytes_, kMaxMessage);
    buffer_ = result.complete ? std::move(result.bytes) : std::vector<std::uint8_t>{};
    bytes_ = buffer_;
  }

  std::string path_;
  BagFiles files_;
  std::set<std::string> topics_;
  std::map<const BagStream*, std::vector<RosMessageType>> types_;
  std::vector<Pending> pending_;  // by start; those before next_ were opened
  std::size_t next_ = 0;
  std::vector<Open> open_;
  std::size_t current_ = SIZE_MAX;  // of open_: the one with the current message
  Stamp begin_;
  Stamp end_;
  Stamp recorded_;
  std::span<const std::uint8_t> bytes_;
  std::vector<std::uint8_t> buffer_;
  bool warned_ = false;
};

}  // namespace

std::unique_ptr<MessageCursor> make_block_cursor(const std::string& path, const BagFiles& files,
                                                 const std::set<std::string>& topics) {
  return std::make_unique<BlockCursor>(path, files, topics);
}

}  // namespace apvi::io
