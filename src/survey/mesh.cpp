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
#include "survey/mesh_support.hpp"
#include "survey/mesh_views.hpp"

namespace apvi::survey {
namespace {

namespace fs = std::filesystem;
using torch::Tensor;

constexpr double kTruncation = 4.0;  // [voxels]
constexpr double kSupport = 2.0;     // [voxels] from the depth of a view that shows a surface

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

/// The vertices where `kept` [n] is true, and the triangles between them.
Mesh part_of(const Mesh& mesh, const Tensor& kept) {
  const Tensor corners = mesh.triangles.to(torch::kInt64);
  const Tensor whole =
      kept.index_select(0, corners.flatten()).view({-1, 3}).all(1).nonzero().squeeze(1);
  const Tensor triangles = corners.index_select(0, whole);
  Tensor used = torch::zeros_like(kept);
  used.index_fill_(0, triangles.flatten(), true);
  const Tensor number = used.to(torch::kInt64).cumsum(0) - 1;
  return {mesh.vertices.index({used}), mesh.colors.index({used}),
          number.index_select(0, triangles.flatten()).view({-1, 3}).to(torch::kInt32)};
}

/// glTF has y up and z to the south.
SE3 gltf_axes() {
  Eigen::Matrix3d R;
  R << 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0;
  return {Eigen::Quaterniond(R), Eigen::Vector3d::Zero()};
}

}  // namespace

Mesh fuse(const mapping::Map& map, const std::vector<SurveyView>& views, const ColorRule& colors,
          double voxel_m, const Progress& progress) {
  open3d::pipelines::integration::ScalableTSDFVolume volume(
      voxel_m, kTruncation * voxel_m, open3d::pipelines::integration::TSDFVolumeColorType::RGB8);
  double done = 0.0;
  for (const SurveyView& view : views) {
    progress(0.7 * done++ / static_cast<double>(views.size()));
    const MeshView seen = mesh_view(map, view, colors);
    const open3d::geometry::RGBDImage image(to_image(seen.color), to_image(seen.depth));
    volume.Integrate(image, to_intrinsic(view.camera.intrinsics),
                     to_matrix(view.camera.T_camera_world));
  }
  const auto extracted = volume.ExtractTriangleMesh();
  const Mesh mesh{to_tensor(extracted->vertices_), to_tensor(extracted->vertex_colors_),
                  to_tensor(extracted->triangles_)};
  return part_of(mesh, supported_points(mesh.vertices, map, views, kSupport * voxel_m,
                                        [&progress](double f) { progress(0.7 + 0.3 * f); }));
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
