// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <variant>

#include "apvi/io/sequence.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::io {

/// Calls `use(const ImageFrame&)` for the images of a camera that are left in a recording, in order
/// of time, as long as it returns true. None is decoded.
template <typename Use>
void for_each_image(SequenceReader& reader, int camera, const Use& use) {
  while (const auto event = reader.next()) {
    const auto* const frame = std::get_if<ImageFrame>(&*event);
    if (frame != nullptr && frame->camera == camera && !use(*frame)) return;
  }
}

}  // namespace apvi::io
