// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/model/archive.hpp"

#include <torch/torch.h>

#include <array>
#include <cstddef>
#include <ostream>

#include "apvi/core/error.hpp"
#include "core/atomic_file.hpp"
#include "gaussians/device.hpp"

namespace apvi::gaussians {
namespace {

constexpr std::array<const char*, 6> kNames = {"means",           "log_scales", "quaternions",
                                               "logit_opacities", "sh_dc",      "sh_rest"};

c10::IValue read_value(torch::serialize::InputArchive& archive, const char* key) {
  c10::IValue value;
  archive.read(key, value);
  return value;
}

}  // namespace

void write_archive(const std::filesystem::path& file, torch::serialize::OutputArchive& archive) {
  // Reports success to LibTorch, because its writer's destructor throws on failure; write errors
  // are kept in `out` and checked by write_file_atomically.
  write_file_atomically(file, [&archive](std::ostream& out) {
    archive.save_to([&out](const void* bytes, std::size_t count) {
      out.write(static_cast<const char*>(bytes), static_cast<std::streamsize>(count));
      return count;
    });
  });
}

void read_archive(const std::filesystem::path& file,
                  const std::function<void(torch::serialize::InputArchive&)>& read) {
  try {
    torch::serialize::InputArchive archive;
    archive.load_from(file.string(), torch::kCPU);  // independent of the device it was saved from
    read(archive);
  } catch (const c10::Error& e) {
    if (is_out_of_memory(e)) throw;  // not an error of the file
    fail_input("{}: cannot resume from this checkpoint: {}; delete it to start over", file.string(),
               e.what_without_backtrace());
  }
}

std::int64_t read_int(torch::serialize::InputArchive& archive, const char* key) {
  return read_value(archive, key).toInt();
}

double read_double(torch::serialize::InputArchive& archive, const char* key) {
  return read_value(archive, key).toDouble();
}

bool read_bool(torch::serialize::InputArchive& archive, const char* key) {
  return read_value(archive, key).toBool();
}

void write_gaussians(torch::serialize::OutputArchive& archive, const std::string& prefix,
                     const Gaussians& gaussians) {
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    const torch::Tensor& values = *gaussians.tensors()[k];
    // A copy, also on the CPU: an archive would store the whole buffer of a view.
    archive.write(prefix + kNames[k], values.to(torch::kCPU, values.scalar_type(),
                                                /*non_blocking=*/false, /*copy=*/true));
  }
}

Gaussians read_gaussians(torch::serialize::InputArchive& archive, const std::string& prefix) {
  Gaussians gaussians;
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    torch::Tensor& tensor = *gaussians.tensors()[k];
    archive.read(prefix + kNames[k], tensor);
    tensor = tensor.detach().to(torch::kCPU).contiguous();
  }
  check(gaussians);
  return gaussians;
}

}  // namespace apvi::gaussians
