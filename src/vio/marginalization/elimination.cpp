// SPDX-License-Identifier: BSD-3-Clause
#include "vio/marginalization/elimination.hpp"

#include <algorithm>

namespace apvi::vio {
namespace {

std::size_t at(int i) {
  return static_cast<std::size_t>(i);
}

// Among several scalar blocks in one term, only the one with the fewest terms may be a landmark:
// the depth of a point rather than the time offset of the camera.
std::vector<char> find_landmarks(const LinearTerms& terms, const std::vector<char>& eliminate) {
  std::vector<char> is_landmark(eliminate.size());
  std::vector<int> uses(eliminate.size());
  for (std::size_t v = 0; v < eliminate.size(); ++v) {
    const LinearTerms::Variable& variable = terms.variables()[v];
    is_landmark[v] = eliminate[v] != 0 && variable.block.size == 1 && !variable.constant ? 1 : 0;
  }
  for (const auto& term : terms.terms()) {
    for (const auto& part : terms.parts(term)) ++uses[at(part.variable)];
  }
  for (const auto& term : terms.terms()) {
    int best = -1;
    for (const auto& part : terms.parts(term)) {
      const int v = part.variable;
      if (is_landmark[at(v)] != 0 && (best < 0 || uses[at(v)] < uses[at(best)])) best = v;
    }
    for (const auto& part : terms.parts(term)) {
      if (part.variable != best) is_landmark[at(part.variable)] = 0;
    }
  }
  return is_landmark;
}

// Eliminated blocks first, then the remaining; poses last in each group, as motions couple only to
// neighbors and are cheap to eliminate before poses, which landmarks couple to each other.
void choose_order(const LinearTerms& terms, const std::vector<char>& eliminate, Elimination& plan) {
  const auto key = [&](int v) {
    const bool is_pose = terms.variables()[at(v)].block.size == 7;
    return (eliminate[at(v)] != 0 ? 0 : 2) + (is_pose ? 1 : 0);
  };
  std::ranges::stable_sort(plan.order, {}, key);
  plan.column.assign(1, 0);
  for (std::size_t i = 0; i < plan.order.size(); ++i) {
    const int v = plan.order[i];
    plan.position[at(v)] = static_cast<int>(i);
    plan.column.push_back(plan.column.back() + terms.variables()[at(v)].block.tangent());
    if (eliminate[at(v)] != 0) ++plan.eliminated;
  }
}

}  // namespace

Elimination plan_elimination(const LinearTerms& terms, const std::vector<char>& eliminate) {
  const std::vector<char> is_landmark = find_landmarks(terms, eliminate);
  Elimination plan;
  plan.position.assign(eliminate.size(), Elimination::kConstant);
  std::vector<int> landmark_index(eliminate.size(), -1);
  int landmarks = 0;
  for (std::size_t v = 0; v < eliminate.size(); ++v) {
    if (terms.variables()[v].constant) continue;
    if (is_landmark[v] == 0) {
      plan.order.push_back(static_cast<int>(v));
    } else {
      plan.position[v] = Elimination::kLandmark;
      landmark_index[v] = landmarks++;
    }
  }
  choose_order(terms, eliminate, plan);
  plan.terms_of_landmark.resize(at(landmarks));
  for (std::size_t t = 0; t < terms.terms().size(); ++t) {
    const auto parts = terms.parts(terms.terms()[t]);
    const auto landmark = std::ranges::find_if(
        parts, [&](const auto& part) { return landmark_index[at(part.variable)] >= 0; });
    auto& list = landmark == parts.end()
                     ? plan.other_terms
                     : plan.terms_of_landmark[at(landmark_index[at(landmark->variable)])];
    list.push_back(static_cast<int>(t));
  }
  return plan;
}

}  // namespace apvi::vio
