// SPDX-License-Identifier: BSD-3-Clause
#include "core/interrupt.hpp"

#include <atomic>
#include <csignal>

namespace apvi {
namespace {

std::atomic<bool> signal_received = false;  // signal handlers are per process
static_assert(std::atomic<bool>::is_always_lock_free);

extern "C" void handle_signal(int number) {
  signal_received = true;
  std::signal(number, SIG_DFL);  // a second Ctrl-C terminates the process
}

}  // namespace

InterruptGuard::InterruptGuard() {
  signal_received = false;
  std::signal(SIGINT, handle_signal);
  std::signal(SIGTERM, handle_signal);
}

InterruptGuard::~InterruptGuard() {
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
}

bool InterruptGuard::interrupted() const {
  return signal_received;
}

}  // namespace apvi
