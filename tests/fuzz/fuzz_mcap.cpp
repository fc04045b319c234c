// SPDX-License-Identifier: BSD-3-Clause
#include <sys/mman.h>
#include <unistd.h>

#include <string>

#include "apvi/core/error.hpp"
#include "fuzz/fuzz_target.hpp"
#include "io/rosbag/dvl_message.hpp"
#include "io/rosbag/ros_samples.hpp"
#include "io/rosbag2/block_cursor.hpp"

// An MCAP file, read with all its topics.

namespace {

using namespace apvi;

// A file in memory with a path.
class MemoryFile {
 public:
  MemoryFile(const std::uint8_t* data, std::size_t size) : handle_(::memfd_create("fuzz", 0)) {
    fuzz::check(::write(handle_, data, size) == static_cast<ssize_t>(size), "cannot write");
  }
  ~MemoryFile() { ::close(handle_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  std::string path() const { return "/proc/self/fd/" + std::to_string(handle_); }

 private:
  int handle_;
};

void read_all(const std::string& path) {
  const io::BagFiles files = {io::open_mcap(path)};
  std::set<std::string> topics;
  for (const io::BagStream& stream : files[0]->streams()) topics.insert(stream.topic);
  const auto cursor = io::make_block_cursor(path, files, topics);
  while (cursor->advance()) {
    fuzz::check(topics.contains(cursor->topic()), "a topic was not asked for");
    fuzz::check(cursor->fraction() >= 0.0 && cursor->fraction() <= 1.0,
                "progress is not in [0, 1]");
    const auto message = cursor->message();
    if (!message) continue;
    io::imu_of(*message, cursor->recorded());
    io::dvl_of(*message, cursor->recorded());
    io::image_of(0, "fuzz")(*message, cursor->recorded());
  }
  fuzz::check(cursor->fraction() == 1.0, "progress at the end is not 1");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  try {
    read_all(file.path());
  } catch (const InputError&) {
  }
  return 0;
}
