// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace apvi {

/// While one of these lives, SIGINT and SIGTERM set a flag instead of ending the process, so that
/// what was computed can be saved. A second signal ends the process in the usual way.
class InterruptGuard {
 public:
  InterruptGuard();
  ~InterruptGuard();
  InterruptGuard(const InterruptGuard&) = delete;
  InterruptGuard& operator=(const InterruptGuard&) = delete;

  /// Whether a signal has come since construction. Safe from any thread.
  bool interrupted() const;
};

}  // namespace apvi
