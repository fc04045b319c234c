// SPDX-License-Identifier: BSD-3-Clause
#include "live/socket.hpp"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <memory>
#include <system_error>

#include "apvi/core/error.hpp"
#include "core/text.hpp"
#include "live/link.hpp"

namespace apvi::live {
namespace {

constexpr std::chrono::seconds kConnectTimeout{3};

std::string reason() {
  return std::generic_category().message(errno);
}

using AddressList = std::unique_ptr<addrinfo, void (*)(addrinfo*)>;

AddressList resolve(const Address& address, int type, bool listen) {
  addrinfo hints{};
  hints.ai_family = listen && address.host.empty() ? AF_INET : AF_UNSPEC;
  hints.ai_socktype = type;
  hints.ai_flags = AI_NUMERICSERV | (listen ? AI_PASSIVE : 0);
  addrinfo* list = nullptr;
  const char* host = address.host.empty() ? nullptr : address.host.c_str();
  const int error = getaddrinfo(host, std::to_string(address.port).c_str(), &hints, &list);
  if (error != 0) fail_run("{}: {}", to_string(address), gai_strerror(error));
  return {list, freeaddrinfo};
}

bool ready(int fd, short events, std::chrono::milliseconds timeout) {
  pollfd entry{.fd = fd, .events = events, .revents = 0};
  return poll(&entry, 1, static_cast<int>(timeout.count())) > 0;
}

void finish_connect(int fd, const std::stop_token& stop) {
  const auto end = std::chrono::steady_clock::now() + kConnectTimeout;
  while (!ready(fd, POLLOUT, kPollPeriod)) {
    if (stop.stop_requested()) fail_run("stopped");
    if (std::chrono::steady_clock::now() > end) fail_run("no answer");
  }
  int error = 0;
  socklen_t size = sizeof error;
  getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &size);
  if (error != 0) fail_run("{}", std::generic_category().message(error));
}

std::optional<std::uint16_t> port_in(const std::string& text) {
  const auto value = text::parse_int64(text);
  if (!value || *value < 0 || *value > 65535) return std::nullopt;
  return static_cast<std::uint16_t>(*value);
}

}  // namespace

std::optional<Address> parse_address(const std::string& text, std::uint16_t default_port) {
  const std::size_t colon = text.rfind(':');
  const bool bracketed = !text.empty() && text.front() == '[';
  const bool has_port = colon != std::string::npos && !(bracketed && text.back() == ']');
  std::string host = has_port ? text.substr(0, colon) : text;
  const auto only_port = has_port ? std::nullopt : port_in(text);
  if (only_port) return Address{"", *only_port};
  const auto port = has_port ? port_in(text.substr(colon + 1)) : std::optional(default_port);
  if (bracketed && host.size() >= 2) host = host.substr(1, host.size() - 2);
  if (!port || (*port == 0 && !has_port)) return std::nullopt;
  return Address{host, *port};
}

std::string to_string(const Address& address) {
  return fmt::format("{}:{}", address.host, address.port);
}

Socket Socket::open(const Address& address, int type, bool listen) {
  const AddressList list = resolve(address, type, listen);
  Socket socket(::socket(list->ai_family, type | SOCK_NONBLOCK | SOCK_CLOEXEC, 0),
                type == SOCK_STREAM);
  if (socket.fd_ < 0) fail_run("{}: {}", to_string(address), reason());
  const auto attach = listen ? ::bind : ::connect;
  if (attach(socket.fd_, list->ai_addr, list->ai_addrlen) != 0 && errno != EINPROGRESS) {
    fail_run("{}: {}", to_string(address), reason());
  }
  return socket;
}

Socket Socket::connect_tcp(const Address& address, const std::stop_token& stop) {
  Socket socket = open(address, SOCK_STREAM, false);
  finish_connect(socket.fd_, stop);
  return socket;
}

Socket Socket::bind_udp(const Address& address) {
  return open(address, SOCK_DGRAM, true);
}

Socket Socket::connect_udp(const Address& address) {
  return open(address, SOCK_DGRAM, false);
}

Socket::~Socket() {
  if (fd_ >= 0) close(fd_);
}

bool Socket::wait(std::chrono::milliseconds timeout) const {
  return ready(fd_, POLLIN, timeout);
}

std::size_t Socket::read(std::span<std::uint8_t> buffer) {
  sender_size_ = sizeof sender_;
  const ssize_t size = recvfrom(fd_, buffer.data(), buffer.size(), 0,
                                reinterpret_cast<sockaddr*>(&sender_), &sender_size_);
  if (size > 0) return static_cast<std::size_t>(size);
  sender_size_ = 0;
  if (size == 0 && stream_) fail_run("the connection was closed");
  if (size == 0 || errno == EAGAIN || errno == EINTR) return 0;
  fail_run("{}", reason());
}

bool Socket::send(std::span<const std::uint8_t> bytes) const {
  return ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL) ==
         static_cast<ssize_t>(bytes.size());
}

bool Socket::answer(std::span<const std::uint8_t> bytes) const {
  if (sender_size_ == 0) return send(bytes);
  return sendto(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL,
                reinterpret_cast<const sockaddr*>(&sender_),
                sender_size_) == static_cast<ssize_t>(bytes.size());
}

std::uint16_t Socket::port() const {
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  getsockname(fd_, reinterpret_cast<sockaddr*>(&address), &size);
  return ntohs(address.ss_family == AF_INET6
                   ? reinterpret_cast<const sockaddr_in6*>(&address)->sin6_port
                   : reinterpret_cast<const sockaddr_in*>(&address)->sin_port);
}

}  // namespace apvi::live
