// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>

/// Who may look: decided from the first lines of a request, without sockets.
namespace apvi::viewer {

/// Whether an address is that of this machine alone.
bool is_loopback(std::string_view address);

/// 128 random bits in hexadecimal digits.
std::string random_token();

struct Access {
  bool loopback = true;  ///< bound to an address of this machine alone
  std::string token;     ///< empty: none is needed
};

/// What a request says of itself; empty: not said.
struct RequestFacts {
  std::string_view method;
  std::string_view target;  ///< path and query
  std::string_view host;
  std::string_view origin;
  bool upgrade = false;  ///< asks for a WebSocket
};

enum class Answer {
  page = 200,
  socket = 101,
  unauthorized = 401,
  forbidden = 403,
  not_found = 404,
  not_allowed = 405,
};

/// The token (`?token=`) is checked before the path, so that a stranger learns nothing. A page of
/// another origin must not connect. Bound to this machine alone, the host must be its name too: a
/// foreign name that resolves to it (DNS rebinding) is refused.
Answer answer_to(const RequestFacts& request, const Access& access);

}  // namespace apvi::viewer
