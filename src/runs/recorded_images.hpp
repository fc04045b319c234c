// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <variant>

#include "apvi/io/sequence.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::runs {

/// Calls `use(const ImageFrame&)` for the images of camera 0 that are left in a recording, in order
/// of time. None is decoded.
template <typename Use>
void for_each_image(io::SequenceReader& reader, const Use& use) {
  while (const auto event = reader.next()) {
    const auto* const frame = std::get_if<ImageFrame>(&*event);
    if (frame != nullptr && frame->camera == 0) use(*frame);
  }
}

}  // namespace apvi::runs
