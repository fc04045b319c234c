// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sys/socket.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <stop_token>
#include <string>

namespace apvi::live {

struct Address {
  std::string host;  ///< empty: any, for a socket that listens
  std::uint16_t port = 0;
};

/// "HOST:PORT", "[IPV6]:PORT", ":PORT" or "PORT"; with a default port also "HOST". nullopt for
/// another text.
std::optional<Address> parse_address(const std::string& text, std::uint16_t default_port = 0);
std::string to_string(const Address& address);

/// A socket that never blocks. All functions throw RunError with the system's reason.
class Socket {
 public:
  /// Connects, within three seconds or until a stop is requested.
  static Socket connect_tcp(const Address& address, const std::stop_token& stop);
  /// Receives datagrams; port 0: the system chooses.
  static Socket bind_udp(const Address& address);
  /// Sends datagrams to the address and receives those that come from it.
  static Socket connect_udp(const Address& address);

  Socket(Socket&& other) noexcept : fd_(other.fd_) { other.fd_ = -1; }
  Socket& operator=(Socket&&) = delete;
  ~Socket();

  /// Whether there is something to read within the time.
  bool wait(std::chrono::milliseconds timeout) const;
  /// Reads what is there, or one datagram; 0 when there is nothing. Throws when the peer of a
  /// connection has closed it. The sender of a datagram is remembered for `answer`.
  std::size_t read(std::span<std::uint8_t> buffer);
  /// False when it cannot be sent now.
  bool send(std::span<const std::uint8_t> bytes) const;
  /// Sends a datagram to the last sender; false when there is none yet.
  bool answer(std::span<const std::uint8_t> bytes) const;
  std::uint16_t port() const;

 private:
  Socket(int fd, bool stream) : fd_(fd), stream_(stream) {}
  static Socket open(const Address& address, int type, bool listen);

  int fd_ = -1;
  bool stream_ = false;
  sockaddr_storage sender_{};
  socklen_t sender_size_ = 0;
};

}  // namespace apvi::live
