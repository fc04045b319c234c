// SPDX-License-Identifier: BSD-3-Clause
#include "core/text_file.hpp"

#include <gtest/gtest.h>

#include "support/tmp_dir.hpp"

namespace apvi {
namespace {

TEST(ReadText, KeepsEveryByte) {
  const test::TmpDir dir;
  const std::string text = std::string("a\r\nb\0c\n\n", 8);
  EXPECT_EQ(read_text(dir.write("file", text)), text);
  EXPECT_EQ(read_text(dir.path() / "absent"), "");
}

TEST(LastLine, SkipsBlankLinesAndTrims) {
  const test::TmpDir dir;
  EXPECT_EQ(last_line(dir.write("log", "start\n  error: no disk space \r\n\n  \n")),
            "error: no disk space");
  EXPECT_EQ(last_line(dir.write("blank", "\n \n")), "");
  EXPECT_EQ(last_line(dir.path() / "absent"), "");
}

}  // namespace
}  // namespace apvi
