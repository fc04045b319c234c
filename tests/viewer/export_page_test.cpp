// SPDX-License-Identifier: BSD-3-Clause
#include "viewer/export_page.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace apvi::viewer {
namespace {

using testing::HasSubstr;

TEST(ExportPage, HoldsTheGaussiansAndTheMedium) {
  StaticMap map;
  map.splats.push_back({.mean = {1, 0, 0}, .sigmas = {0, 0, 0}, .quaternion = {1, 0, 0, 0}});
  map.splats.back().color = {4, 0, 2};
  map.splats.back().opacity = 1.0F;
  map.water = StaticMap::Water{.beta_d = {0.5, 0.25, 0.125}};
  const std::string page = export_page({}, map);
  EXPECT_THAT(page, HasSubstr(R"("beta_d":[0.5,0.25,0.125])"));
  // 1.0f is 00 00 80 3f; the quaternion ff 80 80 80; the color ff ff 00 00 00 80; the opacity ff
  // ff.
  EXPECT_THAT(
      page,
      HasSubstr("id=\"splat-data\">AACAPwAAAAAAAAAAAAAAAAAAAAAAAAAA/4CAgP//AAAAgP//</script>"));
}

TEST(ExportPage, AMapWithoutAMediumHasNoWater) {
  EXPECT_THAT(export_page({}, {}), testing::Not(HasSubstr("\"water\":{")));
}

}  // namespace
}  // namespace apvi::viewer
