// SPDX-License-Identifier: BSD-3-Clause
#include "vio/result.hpp"

namespace apvi::vio {

std::string_view to_string(Status status) {
  switch (status) {
    case Status::waiting:
      return "waiting";
    case Status::started:
      return "started";
    case Status::tracking:
      return "tracking";
    case Status::blind:
      return "blind";
    case Status::frozen:
      return "frozen";
    case Status::lost:
      return "lost";
  }
  return "unknown";
}

}  // namespace apvi::vio
