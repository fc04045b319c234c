// SPDX-License-Identifier: BSD-3-Clause
#include "map_io/ply.hpp"

#include <fmt/format.h>
#include <torch/torch.h>

#include <algorithm>
#include <ostream>
#include <string>

#include "core/atomic_file.hpp"
#include "map_io/map_comments.hpp"

namespace apvi::map_io {
namespace {

namespace fs = std::filesystem;
using torch::Tensor;

constexpr std::int64_t kRowsPerBatch = 4096;

std::string header_text(std::int64_t count, std::int64_t rest, const std::string& comments) {
  std::string text = "ply\nformat binary_little_endian 1.0\n" + comments;
  text += fmt::format("element vertex {}\n", count);
  const auto property = [&text](const std::string& name) {
    text += "property float " + name + "\n";
  };
  for (const char* name : {"x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"}) {
    property(name);
  }
  for (std::int64_t i = 0; i < 3 * rest; ++i) property("f_rest_" + std::to_string(i));
  for (const char* name :
       {"opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"}) {
    property(name);
  }
  return text + "end_header\n";
}

// Rows [begin, end) in file order.
Tensor file_rows(const gaussians::Gaussians& g, std::int64_t begin, std::int64_t end) {
  const auto rows = [&](const Tensor& tensor) {
    return tensor.detach().slice(0, begin, end).to(torch::kCPU, torch::kFloat32);
  };
  const std::int64_t n = end - begin;
  return torch::cat({rows(g.means), torch::zeros({n, 3}), rows(g.sh_dc),
                     rows(g.sh_rest).transpose(1, 2).reshape({n, -1}),
                     rows(g.logit_opacities).unsqueeze(1), rows(g.log_scales), rows(g.quaternions)},
                    1)
      .contiguous();
}

void check_shapes(const gaussians::Gaussians& g) {
  const std::int64_t n = g.size();
  TORCH_CHECK(g.sh_rest.dim() == 3 && g.sh_rest.size(0) == n && g.sh_rest.size(2) == 3,
              "map: sh_rest has shape ", g.sh_rest.sizes());
  TORCH_CHECK(g.logit_opacities.sizes() == at::IntArrayRef({n}), "map: opacities have shape ",
              g.logit_opacities.sizes());
}

}  // namespace

void write_ply(const fs::path& path, const gaussians::Gaussians& gaussians,
               const std::optional<medium::Medium>& medium, const Origin& origin,
               const CameraResponse& camera) {
  check_shapes(gaussians);
  const gaussians::Gaussians shown = gaussians::with_encoded_colors(gaussians, camera.tone_curve);
  const std::int64_t n = shown.size();
  write_file_atomically(path, [&](std::ostream& out) {
    out << header_text(n, shown.sh_rest.size(1), comment_lines(medium, origin, camera));
    for (std::int64_t begin = 0; begin < n && out; begin += kRowsPerBatch) {
      const Tensor rows = file_rows(shown, begin, std::min(n, begin + kRowsPerBatch));
      out.write(reinterpret_cast<const char*>(rows.data_ptr<float>()),
                static_cast<std::streamsize>(rows.nbytes()));
    }
  });
}

}  // namespace apvi::map_io
