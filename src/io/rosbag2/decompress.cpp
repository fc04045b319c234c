// SPDX-License-Identifier: BSD-3-Clause
#include "io/rosbag2/decompress.hpp"

#include <lz4frame.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <memory>

namespace apvi::io {
namespace {

struct Step {
  std::size_t consumed = 0;
  std::size_t produced = 0;
  bool failed = false;
  bool frame_ended = false;
};

// Calls `step(input, output)` until the input is used up. Grows the output by doubling.
template <typename F>
Decompressed run(std::span<const std::uint8_t> input, std::size_t limit, F&& step) {
  Decompressed out;
  std::size_t size = 0;
  bool ended = input.empty();
  while (true) {
    if (size == out.bytes.size()) {
      out.bytes.resize(std::min(limit, std::max<std::size_t>(64U << 10U, 2 * size)));
    }
    const Step done = step(input, std::span(out.bytes).subspan(size));
    if (done.failed) break;
    input = input.subspan(done.consumed);
    size += done.produced;
    if (done.consumed + done.produced > 0) ended = done.frame_ended;
    out.complete = input.empty() && ended;
    const bool stuck = done.consumed + done.produced == 0;
    if (out.complete || stuck) break;
  }
  out.bytes.resize(size);
  return out;
}

}  // namespace

Decompressed decompress_lz4(std::span<const std::uint8_t> input, std::size_t limit) {
  LZ4F_dctx* created = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&created, LZ4F_VERSION)) != 0) return {};
  const std::unique_ptr<LZ4F_dctx, decltype(&LZ4F_freeDecompressionContext)> context(
      created, &LZ4F_freeDecompressionContext);
  return run(input, limit, [&](std::span<const std::uint8_t> in, std::span<std::uint8_t> out) {
    Step step{in.size(), out.size()};
    const std::size_t hint = LZ4F_decompress(context.get(), out.data(), &step.produced, in.data(),
                                             &step.consumed, nullptr);
    step.failed = LZ4F_isError(hint) != 0;
    step.frame_ended = hint == 0;
    return step;
  });
}

Decompressed decompress_zstd(std::span<const std::uint8_t> input, std::size_t limit) {
  const std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context(ZSTD_createDCtx(),
                                                                     &ZSTD_freeDCtx);
  if (context == nullptr) return {};
  return run(input, limit, [&](std::span<const std::uint8_t> in, std::span<std::uint8_t> out) {
    ZSTD_inBuffer from{in.data(), in.size(), 0};
    ZSTD_outBuffer to{out.data(), out.size(), 0};
    const std::size_t hint = ZSTD_decompressStream(context.get(), &to, &from);
    return Step{from.pos, to.pos, ZSTD_isError(hint) != 0, hint == 0};
  });
}

bool is_zstd(std::span<const std::uint8_t> bytes) {
  constexpr std::array<std::uint8_t, 4> kMagic = {0x28, 0xb5, 0x2f, 0xfd};
  return bytes.size() >= kMagic.size() && std::equal(kMagic.begin(), kMagic.end(), bytes.begin());
}

}  // namespace apvi::io
