// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/error.hpp"

namespace apvi::internal {

void check_failed(const char* condition, const char* file, int line) {
  throw std::logic_error(fmt::format("{}:{}: check failed: {}", file, line, condition));
}

}  // namespace apvi::internal
