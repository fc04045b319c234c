// SPDX-License-Identifier: BSD-3-Clause
#include "survey/mesh.hpp"

#include <open3d/camera/PinholeCameraIntrinsic.h>
#include <open3d/geometry/Image.h>
#include <open3d/geometry/RGBDImage.h>
#include <open3d/geometry/TriangleMesh.h>
#include <open3d/io/TriangleMeshIO.h>
#include <open3d/pipelines/integration/ScalableTSDFVolume.h>
#include <open3d/utility/Logging.h>
#include <torch/torch.h>

#include <cstring>
#include <memory>
#include <system_error>

#include "apvi/core/error.hpp"
#include "survey/mesh_views.hpp"

namespace apvi::survey {
namespace {

namespace fs = std::filesystem;
using torch::Tensor;

constexpr double kTruncation = 4.0;  // [voxels]

open3d::geometry::Image to_image(const Tensor& pixels) {
  const int channels = pixels.dim() == 3 ? static_cast<int>(pixels.size(2)) : 1;
  open3d::geometry::Image image;
  image.Prepare(static_cast<int>(pixels.size(1)), static_cast<int>(pixels.size(0)), channels,
                static_cast<int>(pixels.element_size()));
  std::memcpy(image.data_.data(), pixels.data_ptr(), pixels.nbytes());
  return image;
}

/// Open3D has the center of the first pixel at (0, 0).
open3d::camera::PinholeCameraIntrinsic to_intrinsic(const gaussians::Intrinsics& k) {
  return {k.width, k.height, k.fx, k.fy, k.cx - 0.5, k.cy - 0.5};
}

Eigen::Matrix4d to_matrix(const Tensor& pose) {
  const Tensor values = pose.to(torch::kCPU, torch::kFloat64).contiguous();
  return Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(values.data_ptr<double>());
}

/// Rows [N,3] of the type of `Row`.
template <typename Row>
Tensor to_tensor(const std::vector<Row>& rows) {
  Tensor out = torch::empty({static_cast<std::int64_t>(rows.size()), 3},
                            c10::CppTypeToScalarType<typename Row::Scalar>::value);
  std::memcpy(out.data_ptr(), rows.data(), out.nbytes());
  return out;
}

/// The reverse.
template <typename Row>
std::vector<Row> to_rows(const Tensor& tensor) {
  std::vector<Row> out(static_cast<std::size_t>(tensor.size(0)));
  const Tensor values = tensor.contiguous();
  std::memcpy(static_cast<void*>(out.data()), values.data_ptr(), values.nbytes());
  return out;
}

/// glTF has y up and z to the south.
SE3 gltf_axes() {
  Eigen::Matrix3d R;
  R << 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0;
  return {Eigen::Quaterniond(R), Eigen::Vector3d::Zero()};
}

}  // namespace

Mesh fuse(const mapping::Map& map, const std::vector<gaussians::View>& views,
          const ColorRule& colors, double voxel_m, const Progress& progress) {
  open3d::pipelines::integration::ScalableTSDFVolume volume(
      voxel_m, kTruncation * voxel_m, open3d::pipelines::integration::TSDFVolumeColorType::RGB8);
  double done = 0.0;
  for (const gaussians::View& view : views) {
    progress(done++ / static_cast<double>(views.size()));
    const MeshView seen = mesh_view(map, view, colors);
    const open3d::geometry::RGBDImage image(to_image(seen.color), to_image(seen.depth));
    volume.Integrate(image, to_intrinsic(view.intrinsics), to_matrix(view.T_camera_world));
  }
  const auto mesh = volume.ExtractTriangleMesh();
  return {to_tensor(mesh->vertices_), to_tensor(mesh->vertex_colors_), to_tensor(mesh->triangles_)};
}

void write_mesh(const fs::path& file, const Mesh& mesh, const SE3& T_file_map) {
  // Its warnings would repeat the exception.
  open3d::utility::SetVerbosityLevel(open3d::utility::VerbosityLevel::Error);
  open3d::geometry::TriangleMesh out(to_rows<Eigen::Vector3d>(mesh.vertices),
                                     to_rows<Eigen::Vector3i>(mesh.triangles));
  out.vertex_colors_ = to_rows<Eigen::Vector3d>(mesh.colors);
  out.Transform((file.extension() == ".glb" ? gltf_axes() * T_file_map : T_file_map).matrix());
  out.ComputeVertexNormals();
  out.triangle_normals_.clear();
  fs::path partial = file;
  partial.replace_extension(".partial" + file.extension().string());
  std::error_code error;
  if (open3d::io::WriteTriangleMesh(partial.string(), out)) {
    fs::rename(partial, file, error);
    if (!error) return;
  }
  fs::remove(partial, error);
  fail_run("{}: cannot be written; is the disk full?", file.string());
}

}  // namespace apvi::survey
