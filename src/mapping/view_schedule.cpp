// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/view_schedule.hpp"

#include <torch/torch.h>

#include <algorithm>

namespace apvi::mapping {
namespace {

// A view whose loss stays so many times the mean's after so many uses contradicts the others: its
// pose is wrong, or something swam through it.
constexpr double kContradicts = 2.5;
constexpr std::int64_t kPatience = 8;
constexpr double kSeldom = 0.05;
// Draws after which a use counts 1/e, for each view there is: about so often is each drawn then.
constexpr double kMemory = 20.0;

}  // namespace

void ViewSchedule::add(std::size_t view) {
  entries_.push_back({.view = view});
}

void ViewSchedule::remove(std::size_t view) {
  const auto is_it = [view](const Entry& entry) { return entry.view == view; };
  entries_.erase(std::remove_if(entries_.begin(), entries_.end(), is_it), entries_.end());
}

ViewSchedule::Entry* ViewSchedule::find(std::size_t view) {
  const auto is_it = [view](const Entry& entry) { return entry.view == view; };
  const auto found = std::find_if(entries_.begin(), entries_.end(), is_it);
  return found == entries_.end() ? nullptr : &*found;
}

// A view whose loss is not known counts as one of mean loss.
double ViewSchedule::weight(const Entry& entry, double mean_loss, double mean_uses) const {
  const double loss = entry.loss <= 0.0 || mean_loss <= 0.0 ? 1.0 : entry.loss / mean_loss;
  const double use = (mean_uses + 1.0) / (entry.lately + 1.0);
  if (entry.tries >= kPatience && loss > kContradicts) return kSeldom * use;
  return std::max(1e-9, loss * use);
}

std::size_t ViewSchedule::draw(Random& random) const {
  TORCH_CHECK(!entries_.empty(), "view schedule: there is nothing to draw");
  const bool among_newest = random.uniform() < share_;
  const std::size_t count = among_newest ? std::min(recent_, entries_.size()) : entries_.size();
  const auto first = entries_.end() - static_cast<std::ptrdiff_t>(count);
  double loss = 0.0;
  double uses = 0.0;
  double known = 0.0;
  for (auto e = first; e != entries_.end(); ++e) {
    uses += e->lately;
    loss += e->loss;
    known += e->loss > 0.0 ? 1.0 : 0.0;
  }
  loss /= std::max(1.0, known);
  uses /= static_cast<double>(count);
  double sum = 0.0;
  for (auto e = first; e != entries_.end(); ++e) sum += weight(*e, loss, uses);
  double left = random.uniform() * sum;
  for (auto e = first; e != entries_.end(); ++e) {
    left -= weight(*e, loss, uses);
    if (left <= 0.0) return e->view;
  }
  return entries_.back().view;
}

void ViewSchedule::use(std::size_t view) {
  Entry* const entry = find(view);
  if (entry == nullptr) return;
  const double keep = 1.0 - 1.0 / (kMemory * static_cast<double>(entries_.size()));
  for (Entry& e : entries_) e.lately *= keep;
  entry->lately += 1.0;
  ++entry->uses;
  ++entry->tries;
}

void ViewSchedule::report(std::size_t view, double loss) {
  Entry* const entry = find(view);
  if (entry != nullptr) entry->loss = loss;
}

void ViewSchedule::pardon() {
  for (Entry& entry : entries_) entry.tries = 0;
}

std::int64_t ViewSchedule::uses(std::size_t view) const {
  const auto is_it = [view](const Entry& entry) { return entry.view == view; };
  const auto found = std::find_if(entries_.begin(), entries_.end(), is_it);
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
    row[i][3] = static_cast<double>(e.tries);
    row[i][4] = e.lately;
  }
  archive.write("entries", numbers);
}

void ViewSchedule::load(torch::serialize::InputArchive& archive) {
  torch::Tensor numbers;
  archive.read("entries", numbers);
  TORCH_CHECK(
      numbers.dim() == 2 && numbers.size(1) == 5 && numbers.scalar_type() == torch::kFloat64,
      "view schedule: the archive's entries are none");
  entries_.clear();
  const auto row = numbers.accessor<double, 2>();
  for (std::int64_t i = 0; i < numbers.size(0); ++i) {
    entries_.push_back({.view = static_cast<std::size_t>(row[i][0]),
                        .uses = static_cast<std::int64_t>(row[i][1]),
                        .tries = static_cast<std::int64_t>(row[i][3]),
                        .loss = row[i][2],
                        .lately = row[i][4]});
  }
}

}  // namespace apvi::mapping
