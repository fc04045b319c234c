// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/access.hpp"

#include <gtest/gtest.h>

#include <set>

namespace apvi::viewer {
namespace {

const Access kLocal{.loopback = true, .token = ""};
const Access kRemote{.loopback = false, .token = "0123456789abcdef"};

RequestFacts get(std::string_view target, std::string_view host = "127.0.0.1:8700") {
  return {.method = "GET", .target = target, .host = host, .origin = "", .upgrade = false};
}

RequestFacts socket(std::string_view target, std::string_view host, std::string_view origin) {
  return {.method = "GET", .target = target, .host = host, .origin = origin, .upgrade = true};
}

TEST(Access, ServesThePageAndTheSocketOnly) {
  EXPECT_EQ(answer_to(get("/"), kLocal), Answer::page);
  EXPECT_EQ(answer_to(get("/?x=1"), kLocal), Answer::page);
  EXPECT_EQ(answer_to(socket("/socket", "localhost:8700", "http://localhost:8700"), kLocal),
            Answer::socket);
  for (const char* path : {"/socket", "/map.ply", "/../etc/passwd", "//", "", "/index.html", "*"}) {
    EXPECT_EQ(answer_to(get(path), kLocal), Answer::not_found) << path;
  }
  EXPECT_EQ(answer_to(socket("/", "localhost", ""), kLocal), Answer::not_found);
}

TEST(Access, OtherMethodsAreNotAllowed) {
  RequestFacts request = get("/");
  for (const char* method : {"POST", "PUT", "HEAD", "OPTIONS", ""}) {
    request.method = method;
    EXPECT_EQ(answer_to(request, kLocal), Answer::not_allowed) << method;
  }
}

TEST(Access, StrangersAreUnauthorizedWhateverTheyAskFor) {
  for (const char* target :
       {"/", "/socket", "/nothing", "/?token=", "/?token=0123456789abcdeF",
        "/?token=0123456789abcdef0", "/?token=01234567", "/?xtoken=0123456789abcdef",
        "/?token=0123456789abcdef0123456789abcdef"}) {
    EXPECT_EQ(answer_to(get(target, "seabed:8700"), kRemote), Answer::unauthorized) << target;
  }
  EXPECT_EQ(answer_to(socket("/socket", "seabed", "http://seabed"), kRemote), Answer::unauthorized);
}

TEST(Access, TheTokenOpensThePageAndTheSocket) {
  EXPECT_EQ(answer_to(get("/?token=0123456789abcdef", "seabed:8700"), kRemote), Answer::page);
  EXPECT_EQ(answer_to(get("/?a=b&token=0123456789abcdef&c", "seabed:8700"), kRemote), Answer::page);
  EXPECT_EQ(answer_to(socket("/socket?token=0123456789abcdef", "seabed:8700", "http://seabed:8700"),
                      kRemote),
            Answer::socket);
}

TEST(Access, PagesOfOtherOriginsAreForbidden) {
  for (const char* origin : {"http://evil.example", "null", "http://127.0.0.1:8701",
                             "http://127.0.0.1:8700.evil.example", "file://"}) {
    EXPECT_EQ(answer_to(socket("/socket", "127.0.0.1:8700", origin), kLocal), Answer::forbidden)
        << origin;
  }
}

TEST(Access, ForeignNamesOfThisMachineAreForbidden) {
  for (const char* host : {"evil.example", "evil.example:8700", "", "127.0.0.1.evil.example:8700",
                           "192.168.1.5:8700"}) {
    EXPECT_EQ(answer_to(get("/", host), kLocal), Answer::forbidden) << host;
  }
  for (const char* host : {"localhost", "localhost:9000", "127.0.0.1", "[::1]:8700", "[::1]"}) {
    EXPECT_EQ(answer_to(get("/", host), kLocal), Answer::page) << host;
  }
}

TEST(Access, RandomTokensDiffer) {
  std::set<std::string> tokens;
  for (int i = 0; i < 100; ++i) tokens.insert(random_token());
  EXPECT_EQ(tokens.size(), 100U);
  EXPECT_EQ(tokens.begin()->size(), 32U);
}

}  // namespace
}  // namespace apvi::viewer
