// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/keyframes/view_schedule.hpp"

#include <torch/torch.h>

#include <algorithm>

namespace apvi::mapping {
namespace {

// A view whose loss stays this many times above the mean after this many uses is inconsistent with
// the others, because of a wrong pose or a moving object.
constexpr double kOutlierLossRatio = 2.5;
constexpr std::int64_t kOutlierMinUses = 8;
constexpr double kOutlierWeight = 0.05;
// Time constant of the decay of uses, in draws per view.
constexpr double kUseMemoryPerView = 20.0;

}  // namespace

void ViewSchedule::add(std::size_t view) {
  entries_.push_back({.view = view});
}

void ViewSchedule::remove(std::size_t view) {
  const auto matches = [view](const Entry& entry) { return entry.view == view; };
  entries_.erase(std::remove_if(entries_.begin(), entries_.end(), matches), entries_.end());
}

ViewSchedule::Entry* ViewSchedule::find(std::size_t view) {
  const auto matches = [view](const Entry& entry) { return entry.view == view; };
  const auto found = std::find_if(entries_.begin(), entries_.end(), matches);
  return found == entries_.end() ? nullptr : &*found;
}

// An unknown loss counts as the mean loss.
double ViewSchedule::weight(const Entry& entry, double mean_loss, double mean_uses) const {
  const double loss = entry.loss <= 0.0 || mean_loss <= 0.0 ? 1.0 : entry.loss / mean_loss;
  const double use = (mean_uses + 1.0) / (entry.recent_uses + 1.0);
  if (entry.uses_since_reset >= kOutlierMinUses && loss > kOutlierLossRatio) {
    return kOutlierWeight * use;
  }
  return std::max(1e-9, loss * use);
}

std::vector<const ViewSchedule::Entry*> ViewSchedule::candidates() const {
  const bool all_paused = std::all_of(entries_.begin(), entries_.end(),
                                      [](const Entry& entry) { return entry.paused; });
  std::vector<const Entry*> drawn;
  for (const Entry& entry : entries_) {
    if (all_paused || !entry.paused) drawn.push_back(&entry);
  }
  return drawn;
}

void ViewSchedule::pause(const std::set<std::size_t>& views) {
  for (Entry& entry : entries_) entry.paused = views.count(entry.view) != 0;
}

std::size_t ViewSchedule::draw(Random& random) const {
  const std::vector<const Entry*> all = candidates();
  TORCH_CHECK(!all.empty(), "view schedule: there are no views");
  const bool among_recent = random.uniform() < recent_fraction_;
  const std::size_t count = among_recent ? std::min(recent_count_, all.size()) : all.size();
  const auto first = all.end() - static_cast<std::ptrdiff_t>(count);
  double loss = 0.0;
  double uses = 0.0;
  double count_with_loss = 0.0;
  for (auto e = first; e != all.end(); ++e) {
    uses += (*e)->recent_uses;
    loss += (*e)->loss;
    count_with_loss += (*e)->loss > 0.0 ? 1.0 : 0.0;
  }
  loss /= std::max(1.0, count_with_loss);
  uses /= static_cast<double>(count);
  double sum = 0.0;
  for (auto e = first; e != all.end(); ++e) sum += weight(**e, loss, uses);
  double remaining = random.uniform() * sum;
  for (auto e = first; e != all.end(); ++e) {
    remaining -= weight(**e, loss, uses);
    if (remaining <= 0.0) return (*e)->view;
  }
  return all.back()->view;
}

void ViewSchedule::use(std::size_t view) {
  Entry* const entry = find(view);
  if (entry == nullptr) return;
  const double decay = 1.0 - 1.0 / (kUseMemoryPerView * static_cast<double>(entries_.size()));
  for (Entry& e : entries_) e.recent_uses *= decay;
  entry->recent_uses += 1.0;
  ++entry->uses;
  ++entry->uses_since_reset;
}

void ViewSchedule::report(std::size_t view, double loss) {
  Entry* const entry = find(view);
  if (entry != nullptr) entry->loss = loss;
}

void ViewSchedule::reset_penalties() {
  for (Entry& entry : entries_) entry.uses_since_reset = 0;
}

std::int64_t ViewSchedule::uses(std::size_t view) const {
  const auto matches = [view](const Entry& entry) { return entry.view == view; };
  const auto found = std::find_if(entries_.begin(), entries_.end(), matches);
  return found == entries_.end() ? 0 : found->uses;
}

void ViewSchedule::save(torch::serialize::OutputArchive& archive) const {
  const auto n = static_cast<std::int64_t>(entries_.size());
  torch::Tensor numbers = torch::empty({n, 5}, torch::kFloat64);
  auto row = numbers.accessor<double, 2>();
  for (std::int64_t i = 0; i < n; ++i) {
    const Entry& e = entries_[static_cast<std::size_t>(i)];
    row[i][0] = static_cast<double>(e.view);
    row[i][1] = static_cast<double>(e.uses);
    row[i][2] = e.loss;
    row[i][3] = static_cast<double>(e.uses_since_reset);
    row[i][4] = e.recent_uses;
  }
  archive.write("entries", numbers);
}

void ViewSchedule::load(torch::serialize::InputArchive& archive) {
  torch::Tensor numbers;
  archive.read("entries", numbers);
  TORCH_CHECK(
      numbers.dim() == 2 && numbers.size(1) == 5 && numbers.scalar_type() == torch::kFloat64,
      "checkpoint: the view schedule has a wrong format");
  entries_.clear();
  const auto row = numbers.accessor<double, 2>();
  for (std::int64_t i = 0; i < numbers.size(0); ++i) {
    entries_.push_back({.view = static_cast<std::size_t>(row[i][0]),
                        .uses = static_cast<std::int64_t>(row[i][1]),
                        .uses_since_reset = static_cast<std::int64_t>(row[i][3]),
                        .loss = row[i][2],
                        .recent_uses = row[i][4]});
  }
}

}  // namespace apvi::mapping
