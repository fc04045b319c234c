// SPDX-License-Identifier: BSD-3-Clause
#include "core/task_claim.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "apvi/core/error.hpp"
#include "support/tmp_dir.hpp"

namespace apvi {
namespace {

namespace fs = std::filesystem;

class TaskClaimTest : public testing::Test {
 protected:
  test::TmpDir dir_;
  fs::path file_ = dir_.path() / "task.claim";
};

TEST_F(TaskClaimTest, IsHeldByOneAtATime) {
  auto first = TaskClaim::take(file_);
  ASSERT_TRUE(first);
  EXPECT_FALSE(TaskClaim::take(file_));
  first.reset();
  EXPECT_FALSE(fs::exists(file_));
  EXPECT_TRUE(TaskClaim::take(file_));
}

TEST_F(TaskClaimTest, IsAliveWhileItsProcessRuns) {
  const auto claim = TaskClaim::take(file_);
  DeadClaims dead;
  EXPECT_FALSE(dead.remove_if_dead(file_));
  EXPECT_EQ(claimed_progress(file_), 0.0);
}

TEST_F(TaskClaimTest, DiesWithAProcessOfThisHostAtOnce) {
  std::string host(256, '\0');
  ASSERT_EQ(gethostname(host.data(), host.size()), 0);
  // Above the largest number of a process.
  dir_.write("task.claim", fmt::format("{} 4194305 3 0.25\n", host.c_str()));
  EXPECT_EQ(claimed_progress(file_), 0.25);
  DeadClaims dead;
  EXPECT_TRUE(dead.remove_if_dead(file_));
  EXPECT_FALSE(fs::exists(file_));
}

TEST_F(TaskClaimTest, OfAnotherHostDiesWhenItIsSilent) {
  dir_.write("task.claim", "elsewhere 1 3 0.25\n");
  DeadClaims patient(1000.0);
  EXPECT_FALSE(patient.remove_if_dead(file_));
  DeadClaims impatient(0.0);
  EXPECT_TRUE(impatient.remove_if_dead(file_));
}

TEST_F(TaskClaimTest, NamesAFolderThatCannotBeWritten) {
  EXPECT_THROW(TaskClaim::take("/nowhere/task.claim"), RunError);
  EXPECT_FALSE(claimed_progress("/nowhere/task.claim"));
}

}  // namespace
}  // namespace apvi
