// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/server.hpp"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/host_name.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <thread>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "viewer/connection.hpp"
#include "viewer/page.hpp"

namespace apvi::viewer {
namespace {

namespace asio = boost::asio;
using Tcp = asio::ip::tcp;

Tcp::endpoint endpoint_of(const ServerOptions& options) {
  boost::system::error_code error;
  const auto address = asio::ip::make_address(options.address, error);
  if (error) fail_input("viewer: {}: not an IP address; use 127.0.0.1 or 0.0.0.0", options.address);
  if (options.port < 0 || options.port > 65535) fail_input("viewer: {}: not a port", options.port);
  return {address, static_cast<std::uint16_t>(options.port)};
}

Tcp::acceptor listen(asio::io_context& context, const ServerOptions& options) {
  const Tcp::endpoint endpoint = endpoint_of(options);
  try {
    return {context, endpoint};
  } catch (const boost::system::system_error& error) {
    fail_run("viewer: cannot listen on {} port {}: {}; choose another port", options.address,
             options.port, error.code().message());
  }
}

Access access_of(const ServerOptions& options) {
  const bool loopback = is_loopback(options.address);
  const bool random = options.token.empty() && !loopback;
  return {.loopback = loopback, .token = random ? random_token() : options.token};
}

}  // namespace

struct Server::Implementation {
  Implementation(Scene& scene, const ServerOptions& server)
      : loop(scene, server.render_share),
        hub{.scene = scene, .loop = loop, .access = access_of(server), .page = live_page()},
        acceptor(listen(context, server)),
        thread([this] { run(); }) {}
  ~Implementation() {
    context.stop();
    thread.join();
    loop.stop();  // it delivers to the context
  }
  Implementation(const Implementation&) = delete;
  Implementation& operator=(const Implementation&) = delete;

  void run() {
    accept();
    // A handler that throws (out of memory, say) costs its connection, not the server.
    while (!context.stopped()) {
      try {
        context.run();
      } catch (const std::exception& error) {
        log::warning("viewer: {}", error.what());
      }
    }
  }

  void accept() {
    acceptor.async_accept([this](boost::system::error_code error, Tcp::socket socket) {
      if (error) return accept_later();
      serve(std::move(socket), hub);
      accept();
    });
  }
  // No file descriptor is left, for instance.
  void accept_later() {
    pause.expires_after(std::chrono::milliseconds(100));
    pause.async_wait([this](boost::system::error_code) { accept(); });
  }

  void broadcast(Outgoing message) {
    asio::post(context, [this, shared = std::move(message)] {
      const auto watchers = hub.watchers;  // sending may remove one
      for (const auto& [id, send] : watchers) {
        if (hub.watchers.contains(id)) send(shared);
      }
    });
  }

  RenderLoop loop;
  Hub hub;
  asio::io_context context{1};  // after what its connections use, which go with it
  Tcp::acceptor acceptor;
  asio::steady_timer pause{context};
  std::thread thread;
};

Server::Server(Scene& scene, const ServerOptions& options)
    : implementation_(std::make_unique<Implementation>(scene, options)) {}

Server::~Server() = default;

std::string Server::url() const {
  const Tcp::endpoint endpoint = implementation_->acceptor.local_endpoint();
  const std::string& token = implementation_->hub.access.token;
  // Bound to all addresses, it is reached by any of them.
  const std::string address =
      endpoint.address().is_unspecified() ? asio::ip::host_name() : endpoint.address().to_string();
  const bool brackets = address.find(':') != std::string::npos;
  return fmt::format("http://{}:{}/{}", brackets ? "[" + address + "]" : address, endpoint.port(),
                     token.empty() ? "" : "?token=" + token);
}

void Server::broadcast(const std::string& text) {
  implementation_->broadcast({.data = text});
}

void Server::broadcast_image(const std::string& image) {
  implementation_->broadcast({.data = image, .binary = true});
}

}  // namespace apvi::viewer
