// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <cstdint>
#include <functional>
#include <map>
#include <string>

#include "viewer/access.hpp"
#include "viewer/render_loop.hpp"

namespace apvi::viewer {

inline constexpr std::size_t kMaxConnections = 64;
inline constexpr std::size_t kMaxWatchers = 32;

/// What connections share. Everything but `loop` and `scene` is used by the thread of the sockets
/// only.
struct Hub {
  Scene& scene;
  RenderLoop& loop;
  Access access;
  std::string page;
  std::size_t connections = 0;
  std::uint64_t next_watcher = 1;
  std::map<std::uint64_t, std::function<void(const Outgoing&)>> watchers = {};
};

/// Serves a connection until it ends: one request, or a watcher. `hub` must outlive it.
void serve(boost::asio::ip::tcp::socket socket, Hub& hub);

}  // namespace apvi::viewer
