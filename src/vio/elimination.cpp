// SPDX-License-Identifier: BSD-3-Clause
#include "elimination.hpp"

#include <algorithm>

namespace apvi::vio {
namespace {

std::size_t at(int i) {
  return static_cast<std::size_t>(i);
}

// Of several single numbers in one term only the one with the fewest terms may go first: a point's
// depth rather than the camera's time offset.
std::vector<char> find_landmarks(const LinearTerms& terms, const std::vector<char>& goes) {
  std::vector<char> is_landmark(goes.size());
  std::vector<int> uses(goes.size());
  for (std::size_t v = 0; v < goes.size(); ++v) {
    const LinearTerms::Variable& variable = terms.variables()[v];
    is_landmark[v] = goes[v] != 0 && variable.block.size == 1 && !variable.constant ? 1 : 0;
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

// What goes before what stays; in each, poses last: what moves is linked to its neighbours only,
// and so is cheap to take out before poses, which landmarks link to each other.
void choose_order(const LinearTerms& terms, const std::vector<char>& goes, Elimination& plan) {
  const auto key = [&](int v) {
    const bool is_pose = terms.variables()[at(v)].block.size == 7;
    return (goes[at(v)] != 0 ? 0 : 2) + (is_pose ? 1 : 0);
  };
  std::ranges::stable_sort(plan.order, {}, key);
  plan.column.assign(1, 0);
  for (std::size_t i = 0; i < plan.order.size(); ++i) {
    const int v = plan.order[i];
    plan.position[at(v)] = static_cast<int>(i);
    plan.column.push_back(plan.column.back() + terms.variables()[at(v)].block.tangent());
    if (goes[at(v)] != 0) ++plan.going;
  }
}

}  // namespace

Elimination plan_elimination(const LinearTerms& terms, const std::vector<char>& goes) {
  const std::vector<char> is_landmark = find_landmarks(terms, goes);
  Elimination plan;
  plan.position.assign(goes.size(), Elimination::kConstant);
  std::vector<int> landmark_index(goes.size(), -1);
  int landmarks = 0;
  for (std::size_t v = 0; v < goes.size(); ++v) {
    if (terms.variables()[v].constant) continue;
    if (is_landmark[v] == 0) {
      plan.order.push_back(static_cast<int>(v));
    } else {
      plan.position[v] = Elimination::kLandmark;
      landmark_index[v] = landmarks++;
    }
  }
  choose_order(terms, goes, plan);
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
