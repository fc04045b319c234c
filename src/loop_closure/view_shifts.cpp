// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/view_shifts.hpp"

#include <algorithm>
#include <functional>

#include "apvi/geometry/so3.hpp"

namespace apvi::loop_closure {
namespace {

bool is_broken_between(const KeyframeGraph& graph, std::size_t before, std::size_t after) {
  for (std::size_t k = before + 1; k <= after; ++k) {
    if (graph.is_break(k)) return true;
  }
  return false;
}

}  // namespace

void ViewShifts::add(std::size_t keyframe, const SE3& T_world_before, const SE3& T_world_after) {
  shifts_.push_back({.keyframe = keyframe,
                     .turn = so3::log(T_world_after.rotation * T_world_before.rotation.conjugate()),
                     .offset = T_world_after.translation - T_world_before.translation});
}

std::optional<ViewShifts::Shift> ViewShifts::at(const KeyframeGraph& graph,
                                                std::size_t keyframe) const {
  const auto after = std::ranges::lower_bound(shifts_, keyframe, std::less{}, &Shift::keyframe);
  const Shift* a = after == shifts_.begin() ? nullptr : &*std::prev(after);
  const Shift* b = after == shifts_.end() ? nullptr : &*after;
  if (a != nullptr && is_broken_between(graph, a->keyframe, keyframe)) a = nullptr;
  if (b != nullptr && is_broken_between(graph, keyframe, b->keyframe)) b = nullptr;
  if (a == nullptr && b == nullptr) return std::nullopt;
  if (a == nullptr) return *b;
  if (b == nullptr) return *a;
  const Stamp begin = graph[a->keyframe].stamp;
  const double u = seconds_between(begin, graph[keyframe].stamp) /
                   seconds_between(begin, graph[b->keyframe].stamp);
  return Shift{.keyframe = keyframe,
               .turn = a->turn + u * (b->turn - a->turn),
               .offset = a->offset + u * (b->offset - a->offset)};
}

SE3 ViewShifts::moved(const KeyframeGraph& graph, std::size_t keyframe,
                      const SE3& T_world_camera) const {
  const auto shift = at(graph, keyframe);
  if (!shift) return T_world_camera;
  return {(so3::exp(shift->turn) * T_world_camera.rotation).normalized(),
          T_world_camera.translation + shift->offset};
}

}  // namespace apvi::loop_closure
