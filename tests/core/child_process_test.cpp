// SPDX-License-Identifier: BSD-3-Clause
#include "core/child_process.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <csignal>
#include <thread>

#include "apvi/core/error.hpp"
#include "core/stopwatch.hpp"
#include "core/text_file.hpp"
#include "support/tmp_dir.hpp"

namespace apvi {
namespace {

using testing::HasSubstr;

ChildProcess shell(const std::string& script, const std::filesystem::path& output) {
  return ChildProcess({"/bin/sh", "-c", script}, output);
}

ChildExit wait(ChildProcess& child) {
  const Stopwatch watch;
  while (watch.seconds() < 20.0) {
    if (const auto exit = child.poll()) return *exit;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  ADD_FAILURE() << "still running";
  return {};
}

void wait_for_text(const std::filesystem::path& file, const std::string& text) {
  const Stopwatch watch;
  while (read_text(file).find(text) == std::string::npos && watch.seconds() < 20.0) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

TEST(ChildProcess, RedirectsStdoutAndStderrAndHasNoInput) {
  const test::TmpDir dir;
  ChildProcess child = shell("echo one; echo two >&2; cat", dir.path() / "out");
  EXPECT_TRUE(wait(child).success());
  EXPECT_EQ(read_text(dir.path() / "out"), "one\ntwo\n");
}

TEST(ChildProcess, ReportsExitStatusAndSignal) {
  const test::TmpDir dir;
  ChildProcess three = shell("exit 3", dir.path() / "out");
  EXPECT_EQ(wait(three).text(), "exit status 3");
  EXPECT_EQ(three.poll()->status, 3);  // keeps its value
  ChildProcess killed = shell("kill -SEGV $$", dir.path() / "out");
  const ChildExit exit = wait(killed);
  EXPECT_EQ(exit.signal, SIGSEGV);
  EXPECT_FALSE(exit.success());
  EXPECT_THAT(exit.text(), HasSubstr("killed by signal 11"));
}

TEST(StopAll, WaitsForProcessesAndKillsThoseThatDoNotExit) {
  const test::TmpDir dir;
  const auto out = [&](const char* name) { return dir.path() / name; };
  ChildProcess polite = shell(
      "trap 'echo saved; exit 0' INT; echo ready; while :; do sleep 0.01; done", out("polite"));
  ChildProcess deaf = shell("trap '' INT; echo ready; while :; do sleep 0.01; done", out("deaf"));
  wait_for_text(out("polite"), "ready");
  wait_for_text(out("deaf"), "ready");
  const std::array<ChildProcess*, 2> all{&polite, &deaf};
  stop_all(all, 1.0);
  EXPECT_EQ(polite.poll()->text(), "exit status 0");
  EXPECT_EQ(read_text(out("polite")), "ready\nsaved\n");
  EXPECT_EQ(deaf.poll()->signal, SIGKILL);
}

TEST(ChildProcess, StopSendsInterrupt) {
  const test::TmpDir dir;
  ChildProcess child =
      shell("trap 'echo saved; exit 0' INT; echo ready; while :; do sleep 0.01; done",
            dir.path() / "out");
  wait_for_text(dir.path() / "out", "ready");
  EXPECT_FALSE(child.poll());
  child.stop();
  EXPECT_TRUE(wait(child).success());
  EXPECT_EQ(read_text(dir.path() / "out"), "ready\nsaved\n");
}

TEST(ChildProcess, IsKilledByDestructor) {
  const test::TmpDir dir;
  {
    ChildProcess child =
        shell("trap '' INT; echo $$; while :; do sleep 0.01; done", dir.path() / "out");
    wait_for_text(dir.path() / "out", "\n");
  }
  const int pid = std::stoi(read_text(dir.path() / "out"));
  EXPECT_EQ(::kill(pid, 0), -1);
}

TEST(ChildProcess, ThrowsWhenProgramCannotBeStarted) {
  const test::TmpDir dir;
  EXPECT_THROW(ChildProcess({"/no/such/program"}, dir.path() / "out"), RunError);
  EXPECT_THROW(shell("true", dir.path() / "no" / "folder" / "out"), RunError);
}

TEST(ChildProcess, CurrentExecutableIsThisTest) {
  EXPECT_THAT(current_executable().filename().string(), HasSubstr("apvi_core_test"));
}

}  // namespace
}  // namespace apvi
