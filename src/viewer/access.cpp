// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/access.hpp"

#include <fmt/format.h>

#include <random>

namespace apvi::viewer {
namespace {

// [::1]:80 and localhost:80 without the port.
std::string_view without_port(std::string_view host) {
  const std::size_t bracket = host.rfind(']');
  const std::size_t colon = host.rfind(':');
  if (colon == std::string_view::npos) return host;
  if (bracket != std::string_view::npos && colon < bracket) return host;
  return host.substr(0, colon);
}

bool is_own_name(std::string_view host) {
  const std::string_view name = without_port(host);
  return name == "localhost" || name == "[::1]" || is_loopback(name);
}

// Takes the same time wherever the two differ.
bool equal(std::string_view given, std::string_view token) {
  unsigned difference = given.size() == token.size() ? 0U : 1U;
  for (std::size_t i = 0; i < token.size(); ++i) {
    const char other = given.empty() ? '\0' : given[i % given.size()];
    difference |= static_cast<unsigned>(static_cast<unsigned char>(token[i] ^ other));
  }
  return difference == 0U;
}

std::string_view token_in(std::string_view query) {
  constexpr std::string_view kName = "token=";
  while (!query.empty()) {
    const std::size_t end = query.find('&');
    const std::string_view part = query.substr(0, end);
    if (part.starts_with(kName)) return part.substr(kName.size());
    query = end == std::string_view::npos ? std::string_view{} : query.substr(end + 1);
  }
  return {};
}

bool is_own_origin(std::string_view origin, std::string_view host) {
  if (origin.empty()) return true;  // not a browser
  for (const std::string_view scheme : {"http://", "https://"}) {
    if (origin.starts_with(scheme) && origin.substr(scheme.size()) == host) return true;
  }
  return false;
}

}  // namespace

bool is_loopback(std::string_view address) {
  const bool numeric = address.find_first_not_of("0123456789.") == std::string_view::npos;
  return (numeric && address.starts_with("127.")) || address == "::1";
}

std::string random_token() {
  std::random_device device;
  std::string token;
  for (int i = 0; i < 4; ++i) token += fmt::format("{:08x}", device());
  return token;
}

Answer answer_to(const RequestFacts& request, const Access& access) {
  const std::size_t mark = request.target.find('?');
  const std::string_view path = request.target.substr(0, mark);
  const std::string_view query =
      mark == std::string_view::npos ? std::string_view{} : request.target.substr(mark + 1);
  if (!access.token.empty() && !equal(token_in(query), access.token)) return Answer::unauthorized;
  if (access.loopback && !is_own_name(request.host)) return Answer::forbidden;
  if (!is_own_origin(request.origin, request.host)) return Answer::forbidden;
  if (request.method != "GET") return Answer::not_allowed;
  if (path == "/socket" && request.upgrade) return Answer::socket;
  return path == "/" && !request.upgrade ? Answer::page : Answer::not_found;
}

}  // namespace apvi::viewer
