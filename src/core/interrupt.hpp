// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace apvi {

/// While an instance exists, SIGINT and SIGTERM set a flag instead of terminating the process, so
/// that results can be saved. A second signal terminates the process as usual.
class InterruptGuard {
 public:
  InterruptGuard();
  ~InterruptGuard();
  InterruptGuard(const InterruptGuard&) = delete;
  InterruptGuard& operator=(const InterruptGuard&) = delete;

  /// Whether a signal was received since construction. Thread-safe.
  bool interrupted() const;
};

}  // namespace apvi
