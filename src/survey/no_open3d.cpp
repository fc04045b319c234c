// SPDX-License-Identifier: BSD-3-Clause
// What a build without Open3D has in place of meshes.
#include "apvi/core/error.hpp"
#include "survey/mesh.hpp"

namespace apvi::survey {

Mesh fuse(const mapping::Map&, const std::vector<SurveyView>&, const ColorRule&, double,
          const Progress&) {
  fail_input("mesh: this build has no Open3D; install libopen3d-dev and build again");
}

void write_mesh(const std::filesystem::path&, const Mesh&, const SE3&) {
  fail_input("mesh: this build has no Open3D; install libopen3d-dev and build again");
}

}  // namespace apvi::survey
