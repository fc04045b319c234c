// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string_view>
#include <vector>

#include "gaussians/render/view.hpp"
#include "mapping/rendering.hpp"

namespace apvi::change {

/// The map of a dive and the views of its images, in a frame that two sessions have in common.
struct Session {
  mapping::Map map;
  std::vector<gaussians::View> views;
};

/// Called with the finished fraction and what is being done; may throw to stop.
using Progress = std::function<void(double, std::string_view)>;

}  // namespace apvi::change
