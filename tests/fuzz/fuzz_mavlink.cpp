// SPDX-License-Identifier: BSD-3-Clause
#include "fuzz/fuzz_target.hpp"
#include "io/mavlink/messages.hpp"

// A datagram. What is read can be written, and then read again.

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace apvi;
  namespace mavlink = io::mavlink;
  mavlink::decode({data, size}, [](const mavlink::Frame& frame) {
    mavlink::interpret(frame);
    std::size_t count = 0;
    mavlink::decode(mavlink::encode(frame, 0), [&](const mavlink::Frame&) { ++count; });
    fuzz::check(count == 1, "a frame is not read back");
  });
  return 0;
}
