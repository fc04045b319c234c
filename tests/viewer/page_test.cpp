// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/page.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <regex>

namespace apvi::viewer {
namespace {

using testing::HasSubstr;
using testing::Not;

TEST(Page, IsOneDocumentWithoutReferencesToOthers) {
  const std::string page = live_page();
  EXPECT_THAT(page, HasSubstr("new WebSocket"));
  EXPECT_THAT(page, HasSubstr("#timeline"));
  EXPECT_FALSE(std::regex_search(page, std::regex("(src|href)=\"(?!data:)")));
  EXPECT_THAT(page, Not(HasSubstr("://")));
  EXPECT_THAT(page, Not(HasSubstr("/* script */")));
}

TEST(Page, AStaticPageHoldsItsDataAndConnectsToNothing) {
  const std::string page = static_page(R"({"name":"</script>"})", "AAAA");
  EXPECT_THAT(page, HasSubstr(R"({"name":"\u003c/script>"})"));
  EXPECT_THAT(page, HasSubstr("id=\"splat-data\">AAAA</script>"));
  EXPECT_THAT(page, Not(HasSubstr("new WebSocket")));
  EXPECT_THAT(page, Not(HasSubstr("://")));
}

}  // namespace
}  // namespace apvi::viewer
