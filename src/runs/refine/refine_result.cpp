// SPDX-License-Identifier: BSD-3-Clause
#include "runs/refine/refine_result.hpp"

#include <torch/torch.h>

#include <cstddef>
#include <utility>

#include "gaussians/model/archive.hpp"

namespace apvi::runs {
namespace {

using torch::Tensor;

Tensor joined(const std::vector<RefineResult>& results, Tensor RefineResult::*member) {
  std::vector<Tensor> parts;
  for (const RefineResult& result : results) {
    if ((result.*member).defined()) parts.push_back(result.*member);
  }
  // All or none, because the images of all blocks follow each other alike.
  return parts.size() == results.size() ? torch::cat(parts) : Tensor();
}

}  // namespace

void write_result(const std::filesystem::path& file, const RefineResult& result) {
  torch::serialize::OutputArchive archive;
  gaussians::write_gaussians(archive, "", result.gaussians);
  archive.write("stamps", torch::tensor(result.stamps_ns, torch::kInt64));
  archive.write("poses", result.poses);
  archive.write("log_gains", result.log_gains);
  archive.write("has_illumination", torch::IValue(result.illumination.defined()));
  if (result.illumination.defined()) archive.write("illumination", result.illumination);
  archive.write("steps", torch::IValue(result.steps));
  archive.write("seconds", torch::IValue(result.seconds));
  gaussians::write_archive(file, archive);
}

RefineResult read_result(const std::filesystem::path& file) {
  RefineResult result;
  gaussians::read_archive(file, [&result](torch::serialize::InputArchive& archive) {
    const auto read = [&archive](const char* name) {
      Tensor tensor;
      archive.read(name, tensor);
      return tensor.detach().cpu().contiguous();
    };
    result.gaussians = gaussians::read_gaussians(archive, "");
    const Tensor stamps = read("stamps");
    const auto* const first = stamps.data_ptr<std::int64_t>();
    result.stamps_ns.assign(first, first + stamps.numel());
    result.poses = read("poses");
    result.log_gains = read("log_gains");
    TORCH_CHECK(
        result.poses.size(0) == stamps.numel() && result.log_gains.numel() == stamps.numel(),
        "result: images do not match");
    if (gaussians::read_bool(archive, "has_illumination")) {
      result.illumination = read("illumination");
    }
    result.steps = gaussians::read_int(archive, "steps");
    result.seconds = gaussians::read_double(archive, "seconds");
  });
  return result;
}

std::map<std::int64_t, std::int64_t> rows_by_stamp(const RefineResult& result) {
  std::map<std::int64_t, std::int64_t> rows;
  for (std::size_t i = 0; i < result.stamps_ns.size(); ++i) {
    rows[result.stamps_ns[i]] = static_cast<std::int64_t>(i);
  }
  return rows;
}

RefineResult join(std::vector<RefineResult> results) {
  RefineResult all;
  all.poses = joined(results, &RefineResult::poses);
  all.log_gains = joined(results, &RefineResult::log_gains);
  all.illumination = joined(results, &RefineResult::illumination);
  for (std::size_t k = 0; k < all.gaussians.tensors().size(); ++k) {
    std::vector<Tensor> parts;
    for (RefineResult& result : results) {
      parts.push_back(std::exchange(*result.gaussians.tensors()[k], Tensor()));
    }
    *all.gaussians.tensors()[k] = torch::cat(parts);
  }
  for (const RefineResult& result : results) {
    all.stamps_ns.insert(all.stamps_ns.end(), result.stamps_ns.begin(), result.stamps_ns.end());
    all.steps += result.steps;
    all.seconds += result.seconds;
  }
  return all;
}

}  // namespace apvi::runs
