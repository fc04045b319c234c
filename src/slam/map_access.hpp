// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <c10/util/Exception.h>

#include <opencv2/core.hpp>
#include <optional>
#include <string>

#include "apvi/core/error.hpp"
#include "apvi/slam/map_snapshot.hpp"
#include "gaussians/device.hpp"
#include "slam/async_mapper.hpp"

/// What the public classes of this module have in common: the map in public types.
namespace apvi::slam {

/// Exceptions of LibTorch and OpenCV become RunError.
template <typename Work>
auto translate_errors(const Work& work) {
  try {
    return work();
  } catch (const c10::Error& error) {
    if (gaussians::is_out_of_memory(error)) {
      fail_run("out of memory on the device: lower mapping.max_gaussians or mapping.image_scale");
    }
    fail_run("LibTorch: {}", error.what_without_backtrace());
  } catch (const cv::Exception& error) {
    fail_run("OpenCV: {}: {}", error.func, error.err);
  }
}

/// Renders in image values, for a camera of gain one.
mapping::MapRendering render_image(const mapping::Map& map, const gaussians::View& view);

/// The same map in public types, and back: float32 on the CPU. The second throws InputError for
/// arrays of contradictory sizes.
MapSnapshot to_snapshot(const MapCopy& copy);
mapping::Map to_map(const MapSnapshot& snapshot);

/// A copy of the map; nothing before the first keyframe is mapped.
std::optional<MapSnapshot> snapshot_of(const AsyncMapper& mapper);
/// Nothing before the first keyframe is mapped. Throws InputError for a camera without pixels.
std::optional<RenderedImages> render_of(const AsyncMapper& mapper, const RenderView& view);
/// Why mapping is disabled; empty while it works. Once `failed` is true, or after `finish`.
std::string error_of(const AsyncMapper& mapper);

}  // namespace apvi::slam
