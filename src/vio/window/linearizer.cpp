// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>

#include "vio/marginalization/elimination.hpp"
#include "vio/marginalization/marginalization.hpp"

namespace apvi::vio {

Prior Linearizer::marginalize(const std::vector<double*>& drop, Method method) const {
  std::vector<const double*> dropped(drop.begin(), drop.end());
  std::ranges::sort(dropped);
  std::vector<char> eliminate;
  for (const auto& variable : terms_.variables()) {
    const bool is_dropped = std::ranges::binary_search(dropped, variable.block.data);
    eliminate.push_back(is_dropped ? 1 : 0);
  }
  const Elimination plan = plan_elimination(terms_, eliminate);
  Prior prior;
  if (plan.columns() == plan.eliminated_columns()) return prior;
  SquareRoot rest =
      method == Method::schur ? eliminate_by_schur(terms_, plan) : eliminate_by_qr(terms_, plan);
  if (rest.r.size() == 0) return prior;
  for (auto i = static_cast<std::size_t>(plan.eliminated); i < plan.order.size(); ++i) {
    const Block& block = terms_.variables()[static_cast<std::size_t>(plan.order[i])].block;
    prior.kept.push_back({block, std::vector<double>(block.data, block.data + block.size)});
  }
  prior.J = std::move(rest.J);
  prior.r = std::move(rest.r);
  return prior;
}

Eigen::Matrix<double, 6, 6> Linearizer::marginal_information(const double* pose) const {
  std::vector<char> eliminate;
  for (const auto& variable : terms_.variables()) {
    eliminate.push_back(variable.block.data == pose ? 0 : 1);
  }
  const Elimination plan = plan_elimination(terms_, eliminate);
  if (plan.columns() - plan.eliminated_columns() != 6) return Eigen::Matrix<double, 6, 6>::Zero();
  return information_by_schur(terms_, plan);
}

}  // namespace apvi::vio
