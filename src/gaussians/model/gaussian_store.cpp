// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/model/gaussian_store.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "gaussians/device.hpp"
#include "gaussians/model/archive.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

constexpr double kGrowth = 1.5;
constexpr std::size_t kTensors = 6;  // of a map
/// Applies a function to every tensor.
template <typename Function>
Gaussians map_tensors(const Gaussians& gaussians, Function function) {
  Gaussians out;
  for (std::size_t k = 0; k < kTensors; ++k) {
    *out.tensors()[k] = function(*gaussians.tensors()[k]);
  }
  return out;
}

Gaussians valid_rows(const Gaussians& buffers, std::int64_t size) {
  return map_tensors(buffers, [&](const Tensor& t) { return t.narrow(0, 0, size); });
}

Gaussians zero_moments(const Gaussians& parameters) {
  return map_tensors(parameters, [](const Tensor& t) {
    return torch::zeros_like(t, t.options().dtype(moment_type(t)));
  });
}

Tensor unanchored(std::int64_t count, const torch::Device& device) {
  return torch::full({count}, GaussianStore::kNoAnchor, torch::dtype(torch::kInt64).device(device));
}

/// A larger buffer with the same leading rows.
Gaussians grow(const Gaussians& buffers, std::int64_t size, std::int64_t capacity) {
  return map_tensors(buffers, [&](const Tensor& t) {
    std::vector<std::int64_t> shape = t.sizes().vec();
    shape[0] = capacity;
    Tensor larger = torch::zeros(shape, t.options());
    larger.narrow(0, 0, size).copy_(t.narrow(0, 0, size));
    return larger;
  });
}

/// A copy in CPU memory, independent of the device's free memory.
Tensor on_host(const Tensor& values) {
  return values.to(torch::kCPU, values.scalar_type(), /*non_blocking=*/false, /*copy=*/true);
}

/// The selected rows; through CPU memory when the device has no room for a copy.
Tensor select_rows(const Tensor& buffer, const Tensor& rows) {
  try {
    return buffer.index_select(0, rows);
  } catch (const c10::Error& error) {
    if (!is_out_of_memory(error)) throw;
    return on_host(buffer).index_select(0, on_host(rows));
  }
}

/// Moves the selected rows to the front of the buffer.
void compact(Tensor& buffer, const Tensor& rows) {
  buffer.narrow(0, 0, rows.size(0)).copy_(select_rows(buffer, rows));
}

Tensor rows_on_host(const Tensor& buffer, const Tensor& rows) {
  return select_rows(buffer, rows).to(torch::kCPU);
}

void copy_or_zero(Tensor& buffer, std::int64_t begin, std::int64_t count, const Tensor* values) {
  Tensor rows = buffer.narrow(0, begin, count);
  values != nullptr ? rows.copy_(*values) : rows.zero_();
}

void check_mask(const Tensor& mask, const char* name, std::int64_t size) {
  TORCH_CHECK(mask.defined() && mask.scalar_type() == torch::kBool && mask.dim() == 1 &&
                  mask.size(0) == size,
              "gaussian store: ", name, " must be bool [", size, "]");
}

/// Converted to the moment type of this device.
Gaussians read_moments(torch::serialize::InputArchive& archive, const std::string& prefix,
                       const Gaussians& parameters) {
  const torch::ScalarType type = moment_type(parameters.means);
  return map_tensors(read_gaussians(archive, prefix), [&](const Tensor& t) { return t.to(type); });
}

bool same_shapes(const Gaussians& a, const Gaussians& b) {
  for (std::size_t k = 0; k < kTensors; ++k) {
    if (a.tensors()[k]->sizes() != b.tensors()[k]->sizes()) return false;
  }
  return true;
}

}  // namespace

std::int64_t GaussianRows::bytes() const {
  std::int64_t sum = anchors.nbytes();
  for (const Gaussians* part : {&parameters, &first, &second}) {
    for (const Tensor* tensor : part->tensors()) sum += tensor->nbytes();
  }
  return sum;
}

GaussianStore::GaussianStore(const Gaussians& gaussians) : size_(gaussians.size()) {
  check(gaussians);
  const torch::NoGradGuard no_grad;
  parameters_ =
      map_tensors(gaussians, [](const Tensor& t) { return t.detach().contiguous().clone(); });
  first_ = zero_moments(parameters_);
  second_ = zero_moments(parameters_);
  anchors_ = unanchored(size_, parameters_.means.device());
}

const Gaussians& GaussianStore::view() const {
  if (!view_.means.defined()) {
    view_ = map_tensors(valid_rows(parameters_, size_),
                        [](const Tensor& t) { return t.detach().requires_grad_(true); });
  }
  return view_;
}

// The anchors define capacity() and grow last: after an out-of-memory error the store counts as not
// grown.
void GaussianStore::reserve(std::int64_t count) {
  if (count <= capacity()) return;
  const auto larger = static_cast<std::int64_t>(kGrowth * static_cast<double>(capacity()));
  const std::int64_t rows = std::max(count, larger);
  for (Gaussians* buffers : {&parameters_, &first_, &second_}) {
    if (buffers->size() < rows) *buffers = grow(*buffers, size_, rows);
  }
  anchors_ = torch::cat({anchors_, unanchored(rows - anchors_.size(0), anchors_.device())});
}

Tensor GaussianStore::anchors() const {
  return anchors_.narrow(0, 0, size_);
}

void GaussianStore::append(const Gaussians& gaussians, const Tensor& anchors,
                           const Gaussians* first, const Gaussians* second) {
  check(gaussians);
  TORCH_CHECK(gaussians.sh_degree() == parameters_.sh_degree(), "gaussian store: degree ",
              gaussians.sh_degree(), " does not match a map of degree ", parameters_.sh_degree());
  const torch::NoGradGuard no_grad;
  const std::int64_t count = gaussians.size();
  TORCH_CHECK(!anchors.defined() || anchors.sizes() == at::IntArrayRef({count}),
              "gaussian store: anchors of shape ", anchors.sizes(), " for ", count, " Gaussians");
  reserve(size_ + count);
  for (std::size_t k = 0; k < kTensors; ++k) {
    parameters_.tensors()[k]->narrow(0, size_, count).copy_(*gaussians.tensors()[k]);
    copy_or_zero(*first_.tensors()[k], size_, count, first ? first->tensors()[k] : nullptr);
    copy_or_zero(*second_.tensors()[k], size_, count, second ? second->tensors()[k] : nullptr);
  }
  Tensor new_anchors = anchors_.narrow(0, size_, count);
  anchors.defined() ? new_anchors.copy_(anchors) : new_anchors.fill_(kNoAnchor);
  size_ += count;
  view_ = {};
}

void GaussianStore::insert(const Gaussians& gaussians, const Tensor& anchors) {
  append(gaussians, anchors, nullptr, nullptr);
}

GaussianRows GaussianStore::take(const Tensor& which) {
  check_mask(which, "the mask of Gaussians to take", size_);
  const torch::NoGradGuard no_grad;
  const Tensor rows = which.nonzero().squeeze(1).to(parameters_.means.device());
  const auto taken = [&](const Gaussians& buffers) {
    return map_tensors(buffers, [&](const Tensor& t) { return rows_on_host(t, rows); });
  };
  GaussianRows out = {.parameters = taken(parameters_),
                      .first = taken(first_),
                      .second = taken(second_),
                      .anchors = rows_on_host(anchors_, rows)};
  prune(which);
  return out;
}

void GaussianStore::put(const GaussianRows& rows) {
  append(rows.parameters, rows.anchors, &rows.first, &rows.second);
}

void GaussianStore::prune(const Tensor& remove) {
  check_mask(remove, "the mask of Gaussians to remove", size_);
  keep_rows(remove.logical_not().nonzero().squeeze(1));
}

void GaussianStore::reorder(const Tensor& order) {
  TORCH_CHECK(order.defined() && order.scalar_type() == torch::kInt64 &&
                  order.sizes() == at::IntArrayRef({size_}),
              "gaussian store: the order must be int64 [", size_, "]");
  keep_rows(order);
}

// Keeps only these rows, in this order.
void GaussianStore::keep_rows(const Tensor& rows) {
  const torch::NoGradGuard no_grad;
  const Tensor kept = rows.to(parameters_.means.device());
  for (Gaussians* buffers : {&parameters_, &first_, &second_}) {
    for (Tensor* tensor : buffers->tensors()) compact(*tensor, kept);
  }
  compact(anchors_, kept);
  size_ = kept.size(0);
  view_ = {};
}

// Through CPU memory, so that the source is freed before the destination is allocated.
void GaussianStore::to(const torch::Device& device) {
  const torch::NoGradGuard no_grad;
  view_ = {};
  const auto move = [&](Tensor& buffer, torch::ScalarType type) {
    buffer = on_host(buffer.narrow(0, 0, size_));
    buffer = buffer.to(device, type);
  };
  for (Tensor* tensor : parameters_.tensors()) move(*tensor, tensor->scalar_type());
  move(anchors_, torch::kInt64);
  const torch::ScalarType type = moment_type(parameters_.means);
  for (Gaussians* moments : {&first_, &second_}) {
    for (Tensor* tensor : moments->tensors()) move(*tensor, type);
  }
}

std::vector<AdamGroup> GaussianStore::groups(const GaussianLearningRates& rates) const {
  const Gaussians& leaves = view();
  const Gaussians first = valid_rows(first_, size_);
  const Gaussians second = valid_rows(second_, size_);
  std::vector<AdamGroup> out;
  for (std::size_t k = 0; k < kTensors; ++k) {
    const Tensor& leaf = *leaves.tensors()[k];
    out.push_back({.parameter = leaf.detach(),
                   .gradient = leaf.grad(),
                   .first = *first.tensors()[k],
                   .second = *second.tensors()[k],
                   .rate = rates.values()[k]});
  }
  return out;
}

void GaussianStore::step(const GaussianLearningRates& rates, const AdamOptions& options,
                         const Tensor& visible) {
  const torch::NoGradGuard no_grad;
  adam_step(groups(rates), ++steps_, options, visible);
  for (Tensor* leaf : view_.tensors()) leaf->mutable_grad() = Tensor();
}

void GaussianStore::step(const GaussianLearningRates& rates, const SparseGradient& gradient,
                         bool visible_only, const AdamOptions& options) {
  const torch::NoGradGuard no_grad;
  adam_step_sparse(groups(rates), gradient, ++steps_, options, visible_only);
}

void GaussianStore::reset_momentum(const Tensor& which) {
  check_mask(which, "the mask of moments to reset", size_);
  const torch::NoGradGuard no_grad;
  const Tensor rows = which.nonzero().squeeze(1).to(parameters_.means.device());
  for (const Gaussians& moments : {first_, second_}) {
    for (const Tensor* tensor : moments.tensors()) tensor->index_fill_(0, rows, 0.0);
  }
}

void GaussianStore::reset_opacity(double highest) {
  TORCH_CHECK(highest > 0.0 && highest < 1.0, "gaussian store: the opacity ", highest,
              " is not inside (0, 1)");
  const torch::NoGradGuard no_grad;
  parameters_.logit_opacities.narrow(0, 0, size_).clamp_max_(std::log(highest / (1.0 - highest)));
  first_.logit_opacities.zero_();
  second_.logit_opacities.zero_();
}

void GaussianStore::transform(const SimilarityTransforms& similarities, const Tensor& which) {
  TORCH_CHECK(which.defined() && which.scalar_type() == torch::kInt64 &&
                  which.sizes() == at::IntArrayRef({size_}),
              "gaussian store: the transform index must be int64 [", size_, "]");
  const torch::NoGradGuard no_grad;
  const Tensor index = which.to(parameters_.means.device());
  const Tensor rows = (index >= 0).nonzero().squeeze(1);
  const Gaussians moved = transformed(
      map_tensors(parameters_, [&](const Tensor& t) { return t.index_select(0, rows); }),
      similarities, index.index_select(0, rows));
  for (std::size_t k = 0; k < kTensors; ++k) {
    parameters_.tensors()[k]->index_copy_(0, rows, *moved.tensors()[k]);
  }
  view_ = {};
}

void GaussianStore::save(torch::serialize::OutputArchive& archive) const {
  archive.write("steps", c10::IValue(steps_));
  write_gaussians(archive, "", valid_rows(parameters_, size_));
  write_gaussians(archive, "first.", valid_rows(first_, size_));
  write_gaussians(archive, "second.", valid_rows(second_, size_));
  archive.write("anchors", on_host(anchors()));
}

GaussianStore GaussianStore::load(torch::serialize::InputArchive& archive) {
  c10::IValue steps;
  archive.read("steps", steps);
  TORCH_CHECK(steps.isInt() && steps.toInt() >= 0,
              "gaussian store: invalid step count in the archive");
  GaussianStore store(read_gaussians(archive, ""));
  store.first_ = read_moments(archive, "first.", store.parameters_);
  store.second_ = read_moments(archive, "second.", store.parameters_);
  TORCH_CHECK(
      same_shapes(store.first_, store.parameters_) && same_shapes(store.second_, store.parameters_),
      "gaussian store: the archive's moments do not match its Gaussians");
  Tensor new_anchors;
  archive.read("anchors", new_anchors);
  TORCH_CHECK(new_anchors.sizes() == at::IntArrayRef({store.size_}) &&
                  new_anchors.scalar_type() == torch::kInt64,
              "gaussian store: the archive's anchors do not match its Gaussians");
  store.anchors_ = new_anchors.to(torch::kCPU);
  store.steps_ = steps.toInt();
  return store;
}

}  // namespace apvi::gaussians
