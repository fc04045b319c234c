// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "viewer/scene.hpp"

/// Messages between page and server. The page sends JSON text; the server sends JSON text and
/// images with a binary header. docs/viewer.md has the fields.
namespace apvi::viewer {

inline constexpr int kMaxSide = 4096;                  ///< of an image [px]
inline constexpr int kMaxPixels = 3840 * 2160;         ///< of an image
inline constexpr std::size_t kMaxMessage = 16 * 1024;  ///< from a page [bytes]

/// Draw this view from now on.
struct ViewMessage {
  std::uint32_t id = 0;  ///< comes back with the images of this view
  View view = {};
  bool moving = false;  ///< more will follow at once: fast images are better than sharp ones
};
/// The page has drawn a frame.
struct DrawnMessage {
  std::uint32_t frame = 0;
};
/// A lossless image of a view at full size.
struct SnapshotMessage {
  std::uint32_t id = 0;
  View view = {};
};
/// The point of the map at a pixel.
struct MeasureMessage {
  std::uint32_t id = 0;
  Viewpoint viewpoint = {};
  int column = 0;
  int row = 0;
};
struct PauseMessage {
  bool paused = false;
};
/// Save the map now.
struct SaveMessage {};
using Message = std::variant<ViewMessage, DrawnMessage, SnapshotMessage, MeasureMessage,
                             PauseMessage, SaveMessage>;

/// Nothing for whatever is not a valid message: never throws.
std::optional<Message> parse_message(std::string_view text);

std::string_view to_string(Layer layer);

/// Kind of an image, the first byte of its header.
enum class ImageKind : std::uint8_t { frame = 1, snapshot = 2, camera = 3 };

/// Header of an image, 24 bytes, little endian: kind, layer, complete, 0 (one byte each), id, view
/// (u32), width, height (u16), near, far (f32).
struct ImageHeader {
  ImageKind kind = ImageKind::frame;
  Layer layer = Layer::seen;
  bool complete = true;    ///< at full size: nothing better follows
  std::uint32_t id = 0;    ///< of the frame, or of the request for a snapshot
  std::uint32_t view = 0;  ///< ViewMessage::id
  int width = 0;
  int height = 0;
  float near_m = 0.0F;  ///< of the layer depth: what the ends of the color scale mean
  float far_m = 0.0F;
};
/// Header and image as one message.
std::string with_header(const ImageHeader& header, std::string_view image);

/// {"type": "point", "id", "point": [x, y, z] or null, "range_m"}
std::string point_message(std::uint32_t id, const std::optional<Eigen::Vector3d>& point,
                          double range_m);
/// {"type": "scene", ...}
std::string scene_message(const SceneDescription& description);
/// {"type": "poses", ...}: poses that follow those of the scene.
std::string poses_message(const std::vector<TracePose>& trace);
/// {"type": "map", ...}: extent, medium and keyframes of a map that has changed.
std::string map_message(const SceneDescription& description);
/// {"type": "loops", ...}: all of them.
std::string loops_message(const std::vector<LoopLine>& loops);
/// {"type": "beams", ...}: all pings.
std::string beams_message(const Beams& beams);
/// {"type": "pings", ...}: those that follow.
std::string pings_message(const std::vector<BeamPing>& pings);
/// {"type": "sensors", ...}: all spans.
std::string sensors_message(const std::vector<SensorTrack>& sensors);
/// {"type": "saved", "error"}; empty: the map is saved.
std::string saved_message(const std::string& error);
/// {"type": "status", "figures": [[name, value], ...], "paused"}
std::string status_message(const std::vector<std::pair<std::string, std::string>>& figures,
                           bool paused);

}  // namespace apvi::viewer
