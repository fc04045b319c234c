// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>

namespace apvi::viewer {

/// The page that a server sends, in one document without references to others.
std::string live_page();
/// The page that needs no server: it draws `splats` (base64 of export_splats) itself. `scene` is a
/// scene message.
std::string static_page(std::string_view scene, std::string_view splats);

}  // namespace apvi::viewer
