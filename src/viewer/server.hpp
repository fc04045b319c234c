// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>

#include "viewer/scene.hpp"

namespace apvi::viewer {

struct ServerOptions {
  std::string address = "127.0.0.1";
  int port = 8700;            ///< 0: any free one
  std::string token;          ///< empty: none, or a random one where the address needs one
  double render_share = 1.0;  ///< greatest fraction of the time to draw in
};

/// Serves the page and draws for everyone who has opened it, on threads of its own, until
/// destroyed. Bound to another address than this machine's own, it demands a token. What a client
/// can make it keep is bounded: connections, sizes of requests and messages, queues.
class Server {
 public:
  /// `scene` must outlive this. Throws InputError for a bad address or port, RunError when it is
  /// taken.
  Server(Scene& scene, const ServerOptions& options);
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  /// Address of the page, with the token if it needs one.
  std::string url() const;
  /// Sends a message to every page; any thread.
  void broadcast(const std::string& text);
  void broadcast_image(const std::string& image);

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace apvi::viewer
