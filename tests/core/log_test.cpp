// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/log.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "apvi/core/error.hpp"
#include "core/status_line.hpp"
#include "support/run_program.hpp"
#include "support/tmp_dir.hpp"

namespace apvi {
namespace {

using testing::HasSubstr;
using testing::Not;

TEST(Log, WritesLevelAndMessageToStandardError) {
  testing::internal::CaptureStderr();
  testing::internal::CaptureStdout();
  log::warning("{} images are missing", 3);
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "warning: 3 images are missing\n");
}

TEST(Log, FileReceivesAllLevels) {
  const test::TmpDir dir;
  testing::internal::CaptureStderr();
  log::open_file(dir.path() / "log.txt");
  log::set_console_level(log::Level::error);
  log::debug("a detail");
  log::info("a fact");
  log::set_console_level(log::Level::info);
  log::close_file();
  log::info("afterwards");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "info: afterwards\n");
  const std::string content = test::read_file(dir.path() / "log.txt");
  EXPECT_THAT(content, HasSubstr("debug: a detail\n"));
  EXPECT_THAT(content, HasSubstr("info: a fact\n"));
  EXPECT_THAT(content, Not(HasSubstr("afterwards")));
}

TEST(Log, DoesNotFormatPlainMessages) {
  testing::internal::CaptureStderr();
  log::write(log::Level::info, "{not} a format %s");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "info: {not} a format %s\n");
}

TEST(Log, ThrowsRunErrorWhenFileCannotBeOpened) {
  EXPECT_THROW(log::open_file("/proc/nonexistent/log.txt"), RunError);
}

TEST(StatusLine, IsRateLimitedWithoutTerminal) {
  testing::internal::CaptureStderr();
  {
    StatusLine status("mapping");
    for (int i = 0; i < 1000; ++i) status.update(0.001 * i, "busy");
    status.finish();
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");  // finished before the first five seconds
}

TEST(Errors, HaveFormattedMessages) {
  try {
    fail_input("{}:{}: {}", "a.yaml", 3, "what");
    FAIL();
  } catch (const InputError& e) {
    EXPECT_STREQ(e.what(), "a.yaml:3: what");
  }
  EXPECT_THROW(fail_run("disk {}", "full"), RunError);
}

TEST(Errors, FailedCheckNamesConditionAndFile) {
  try {
    APVI_CHECK(1 + 1 == 3);
    FAIL();
  } catch (const std::logic_error& e) {
    EXPECT_THAT(e.what(), HasSubstr("1 + 1 == 3"));
    EXPECT_THAT(e.what(), HasSubstr("log_test.cpp"));
  }
}

}  // namespace
}  // namespace apvi
