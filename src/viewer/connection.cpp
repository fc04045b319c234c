// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/connection.hpp"

#include <boost/asio/post.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <deque>
#include <memory>
#include <utility>

namespace apvi::viewer {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using std::chrono::seconds;

constexpr seconds kRequestTime(10);             // for a whole request, and for its answer
constexpr seconds kIdleTime(40);                // without an answer to a ping
constexpr std::uint32_t kMaxHeader = 8 * 1024;  // of a request [bytes]
constexpr std::size_t kMaxQueue = 64;           // messages that a page has not taken yet
constexpr std::size_t kMaxQueuedBytes = std::size_t{64} << 20U;
constexpr int kMaxMalformed = 100;  // messages of one page

using Request = http::request<http::empty_body>;
using Response = http::response<http::string_body>;

// One of Hub::connections.
class Place {
 public:
  explicit Place(Hub& hub) : hub_(&hub) { ++hub_->connections; }
  Place(Place&& other) noexcept : hub_(std::exchange(other.hub_, nullptr)) {}
  Place(const Place&) = delete;
  Place& operator=(const Place&) = delete;
  Place& operator=(Place&&) = delete;
  ~Place() {
    if (hub_ != nullptr) --hub_->connections;
  }

 private:
  Hub* hub_;
};

/// A page that watches.
class WatcherConnection : public std::enable_shared_from_this<WatcherConnection> {
 public:
  WatcherConnection(beast::tcp_stream stream, Hub& hub, Place place)
      : hub_(hub), place_(std::move(place)), socket_(std::move(stream)), id_(hub.next_watcher++) {}
  ~WatcherConnection() { leave(); }
  WatcherConnection(const WatcherConnection&) = delete;
  WatcherConnection& operator=(const WatcherConnection&) = delete;

  void start(const Request& request) {
    beast::get_lowest_layer(socket_).expires_never();
    socket_.set_option(websocket::stream_base::timeout{kRequestTime, kIdleTime, true});
    socket_.read_message_max(kMaxMessage);
    socket_.auto_fragment(false);
    socket_.async_accept(request, [self = shared_from_this()](beast::error_code error) {
      if (!error) self->accepted();
    });
  }

 private:
  void accepted() {
    send({.data = scene_message(hub_.scene.description())});
    hub_.watchers[id_] = [this](const Outgoing& message) { send(message); };
    const auto deliver = [weak = weak_from_this(), executor = socket_.get_executor()](Outgoing m) {
      asio::post(executor, [weak, message = std::move(m)] {
        if (const auto self = weak.lock()) self->send(message);
      });
    };
    hub_.loop.add(id_, deliver);
    read();
  }

  void read() {
    socket_.async_read(buffer_, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error) return self->leave();
      self->take();
    });
  }

  void take() {
    const auto data = buffer_.data();
    const auto message = parse_message(
        {static_cast<const char*>(data.data()), socket_.got_text() ? data.size() : 0});
    buffer_.consume(buffer_.size());
    if (!message && ++malformed_ > kMaxMalformed) return close();
    if (message) act(*message);
    read();
  }

  void act(const Message& message) {
    if (const auto* pause = std::get_if<PauseMessage>(&message)) {
      return hub_.scene.pause(pause->paused);
    }
    if (std::holds_alternative<SaveMessage>(message)) return hub_.scene.save();
    hub_.loop.receive(id_, message);
  }

  void send(const Outgoing& message) {
    if (closing_) return;
    queued_bytes_ += message.data.size();
    queue_.push_back(message);
    if (queue_.size() > kMaxQueue || queued_bytes_ > kMaxQueuedBytes) return drop();
    if (queue_.size() == 1) write();
  }

  void write() {
    socket_.binary(queue_.front().binary);
    socket_.async_write(asio::buffer(queue_.front().data),
                        [self = shared_from_this()](beast::error_code error, std::size_t) {
                          if (error) return self->leave();
                          self->wrote();
                        });
  }

  void wrote() {
    if (queue_.front().frame != 0) hub_.loop.written(id_, queue_.front().frame);
    queued_bytes_ -= queue_.front().data.size();
    queue_.pop_front();
    if (!queue_.empty()) write();
  }

  void close() {
    leave();
    socket_.async_close(websocket::close_code::policy_error,
                        [self = shared_from_this()](beast::error_code) {});
  }
  // It does not read: without the closing handshake, which would wait for it.
  void drop() {
    leave();
    beast::get_lowest_layer(socket_).close();
  }

  void leave() {
    if (std::exchange(closing_, true)) return;
    hub_.watchers.erase(id_);
    hub_.loop.remove(id_);
  }

  Hub& hub_;
  Place place_;
  websocket::stream<beast::tcp_stream> socket_;
  std::uint64_t id_;
  beast::flat_buffer buffer_{kMaxMessage};
  std::deque<Outgoing> queue_;
  std::size_t queued_bytes_ = 0;
  int malformed_ = 0;
  bool closing_ = false;
};

Response response(http::status status, std::string text, const char* type) {
  Response out(status, 11);
  out.set(http::field::content_type, type);
  out.set(http::field::cache_control, "no-store");
  out.set(http::field::x_frame_options, "DENY");
  out.set("Referrer-Policy", "no-referrer");
  out.set("X-Content-Type-Options", "nosniff");
  out.set("Content-Security-Policy",
          "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
          "img-src data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
          "frame-ancestors 'none'");
  out.keep_alive(false);
  out.body() = std::move(text);
  out.prepare_payload();
  return out;
}

Response refusal(http::status status) {
  const auto reason = http::obsolete_reason(status);
  std::string text = std::string(reason.data(), reason.size()) + "\n";
  if (status == http::status::unauthorized) {
    text = "Unauthorized: open the address that apvi has printed, with its token\n";
  }
  return response(status, std::move(text), "text/plain; charset=utf-8");
}

/// One request and its answer.
class RequestConnection : public std::enable_shared_from_this<RequestConnection> {
 public:
  RequestConnection(asio::ip::tcp::socket socket, Hub& hub)
      : hub_(hub), place_(hub), stream_(std::move(socket)) {
    parser_.header_limit(kMaxHeader);
  }

  void start() {
    stream_.expires_after(kRequestTime);
    http::async_read(
        stream_, buffer_, parser_,
        [self = shared_from_this()](beast::error_code error, std::size_t) { self->answer(error); });
  }

 private:
  void answer(beast::error_code error) {
    if (error == http::error::end_of_stream || error == beast::error::timeout) return;
    if (error == http::error::header_limit || error == http::error::buffer_overflow) {
      return reply(refusal(http::status::request_header_fields_too_large));
    }
    if (error) return reply(refusal(http::status::bad_request));
    const Request& request = parser_.get();
    switch (const Answer answer = answer_to(facts_of(request), hub_.access); answer) {
      case Answer::page:
        return reply(response(http::status::ok, hub_.page, "text/html; charset=utf-8"));
      case Answer::socket:
        return upgrade();
      default:
        return reply(refusal(static_cast<http::status>(answer)));
    }
  }

  static RequestFacts facts_of(const Request& request) {
    const auto view = [](beast::string_view s) { return std::string_view(s.data(), s.size()); };
    return {.method = view(request.method_string()),
            .target = view(request.target()),
            .host = view(request[http::field::host]),
            .origin = view(request[http::field::origin]),
            .upgrade = websocket::is_upgrade(request)};
  }

  void upgrade() {
    if (hub_.watchers.size() >= kMaxWatchers) {
      return reply(refusal(http::status::service_unavailable));
    }
    std::make_shared<WatcherConnection>(std::move(stream_), hub_, std::move(place_))
        ->start(parser_.get());
  }

  void reply(Response response) {
    response_ = std::move(response);
    stream_.expires_after(kRequestTime);
    http::async_write(
        stream_, response_, [self = shared_from_this()](beast::error_code, std::size_t) {
          beast::error_code ignored;
          self->stream_.socket().shutdown(asio::ip::tcp::socket::shutdown_send, ignored);
        });
  }

  Hub& hub_;
  Place place_;
  beast::tcp_stream stream_;
  beast::flat_buffer buffer_{kMaxHeader + 1024};
  http::request_parser<http::empty_body> parser_;
  Response response_;
};

}  // namespace

void serve(asio::ip::tcp::socket socket, Hub& hub) {
  if (hub.connections >= kMaxConnections) return;  // closes it
  std::make_shared<RequestConnection>(std::move(socket), hub)->start();
}

}  // namespace apvi::viewer
