// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>

#include "apvi/config/node.hpp"
#include "live/source.hpp"

namespace apvi::live {

struct NamedSource {
  std::unique_ptr<Source> source;
  config::Node rig;  ///< of a recording; null for a device
};

/// The source at an address, not started. Throws InputError for an address that is none, with the
/// known forms.
///
/// | address | delivers |
/// |---|---|
/// | `waterlinked://HOST[:16171]` | DVL |
/// | `mavlink://udp:PORT`, `mavlink://udp:HOST:PORT` | IMU, pressure |
/// | `rtsp://…`, `rtp+h264://:PORT`, `v4l2:///dev/video0`, `video://FILE` | camera |
/// | `play://PATH`, or a path | what a recording holds |
NamedSource make_source(const std::string& address);

/// Whether an address is that of a camera's video.
bool is_video_address(const std::string& address);

}  // namespace apvi::live
