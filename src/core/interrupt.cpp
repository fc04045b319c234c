// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/interrupt.hpp"

#include <atomic>
#include <csignal>

namespace apvi {
namespace {

std::atomic<bool> signalled = false;  // signals belong to the process, hence file scope
static_assert(std::atomic<bool>::is_always_lock_free);

extern "C" void on_signal(int number) {
  signalled = true;
  std::signal(number, SIG_DFL);  // a second Ctrl-C must always work
}

}  // namespace

InterruptGuard::InterruptGuard() {
  signalled = false;
  std::signal(SIGINT, on_signal);
  std::signal(SIGTERM, on_signal);
}

InterruptGuard::~InterruptGuard() {
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
}

bool InterruptGuard::interrupted() const {
  return signalled;
}

}  // namespace apvi
