// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/metrics/lpips_weights.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <torch/torch.h>

#include <fstream>

#include "apvi/core/error.hpp"

namespace apvi::gaussians {
namespace {

std::string line_of(const NamedShape& tensor) {
  return fmt::format("{} {}", tensor.name, fmt::join(tensor.shape, " "));
}

void expect_line(std::istream& in, const std::filesystem::path& file, int number,
                 const std::string& expected) {
  std::string line;
  if (!std::getline(in, line) || line != expected) {
    fail_input("{}:{}: expected \"{}\"; regenerate it with scripts/make_lpips_weights.py",
               file.string(), number, expected);
  }
}

}  // namespace

std::vector<torch::Tensor> read_lpips_weights(const std::filesystem::path& file,
                                              const std::string& net,
                                              const std::vector<NamedShape>& expected) {
  std::ifstream in(file, std::ios::binary);
  if (!in) fail_input("{}: cannot be read", file.string());
  int line = 1;
  expect_line(in, file, line, fmt::format("apvi-lpips 1 {}", net));
  for (const NamedShape& tensor : expected) expect_line(in, file, ++line, line_of(tensor));
  expect_line(in, file, ++line, "");
  std::vector<torch::Tensor> tensors;
  for (const NamedShape& tensor : expected) {
    tensors.push_back(torch::empty(tensor.shape, torch::kFloat32));
    in.read(static_cast<char*>(tensors.back().data_ptr()),
            static_cast<std::streamsize>(tensors.back().nbytes()));
    if (!in) {
      fail_input("{}: {} is truncated; regenerate it with scripts/make_lpips_weights.py",
                 file.string(), tensor.name);
    }
  }
  if (in.peek() != std::char_traits<char>::eof()) {
    fail_input(
        "{}: data after the last tensor; regenerate it with "
        "scripts/make_lpips_weights.py",
        file.string());
  }
  return tensors;
}

}  // namespace apvi::gaussians
