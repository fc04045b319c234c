// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <stdexcept>
#include <string>
#include <utility>

namespace apvi {

/// Base of the errors that the library throws. Exceptions of LibTorch, OpenCV and Ceres do not
/// leave the classes of `apvi/localization` and `apvi/slam`.
class Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Invalid user input: a file, a key, an argument. The message is one line, `file:line: key:
/// problem; remedy`. The program exits with status 2.
class InputError : public Error {
 public:
  using Error::Error;
};

/// Failure with valid input (disk full, no estimate possible). The program exits with status 1.
class RunError : public Error {
 public:
  using Error::Error;
};

/// Throws InputError with a formatted message.
template <typename... Args>
[[noreturn]] void fail_input(fmt::format_string<Args...> format, Args&&... args) {
  throw InputError(fmt::format(format, std::forward<Args>(args)...));
}

/// Throws RunError with a formatted message.
template <typename... Args>
[[noreturn]] void fail_run(fmt::format_string<Args...> format, Args&&... args) {
  throw RunError(fmt::format(format, std::forward<Args>(args)...));
}

namespace internal {
[[noreturn]] void check_failed(const char* condition, const char* file, int line);
}  // namespace internal

}  // namespace apvi

/// Checks an invariant in every build type: throws std::logic_error, never aborts.
#define APVI_CHECK(condition) \
  ((condition) ? void(0) : ::apvi::internal::check_failed(#condition, __FILE__, __LINE__))
