// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "apvi/core/error.hpp"
#include "fuzz/fuzz_target.hpp"
#include "io/folder/image_decode.hpp"

// An image of a message: width, height, step and byte order in a byte each, its encoding, a NUL
// byte, and its pixels. An encoding of "file" is a compressed image.

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::size_t kNumbers = 4;
  if (size < kNumbers) return 0;
  const std::uint8_t* end = std::find(data + kNumbers, data + size, std::uint8_t{0});
  apvi::io::RawImage raw{.name = "fuzz", .bytes = {}, .encoding = {data + kNumbers, end}};
  raw.width = data[0];
  raw.height = data[1];
  raw.step = data[2];
  raw.big_endian = data[3] % 2 == 1;
  raw.compressed = raw.encoding == "file";
  if (end != data + size) raw.bytes.assign(end + 1, data + size);
  if (!raw.compressed && !apvi::io::is_well_formed(raw)) return 0;
  try {
    apvi::fuzz::check(!apvi::io::decode_raw_image(raw).empty(), "an image has no pixels");
  } catch (const apvi::RunError&) {
  }
  return 0;
}
