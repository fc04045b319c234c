// SPDX-License-Identifier: BSD-3-Clause
#include "sim/world/mesh.hpp"

#include <cstddef>
#include <cstring>
#include <fstream>
#include <string>

#include "apvi/core/error.hpp"

namespace apvi::sim {
namespace {

template <typename T>
void append_bytes(std::string& buffer, T value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  buffer.append(bytes, sizeof(T));
}

std::string ply_header(const TriangleMesh& mesh) {
  return fmt::format(
      "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\n"
      "property float y\nproperty float z\nelement face {}\n"
      "property list uchar int vertex_indices\nproperty uchar material\nend_header\n",
      mesh.vertices.size(), mesh.triangles.size());
}

}  // namespace

std::uint32_t TriangleMesh::add_vertex(const Eigen::Vector3f& position, float vertex_detail) {
  vertices.push_back(position);
  detail.push_back(vertex_detail);
  return static_cast<std::uint32_t>(vertices.size() - 1);
}

void TriangleMesh::add_triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c,
                                Material material, std::uint16_t object) {
  triangles.push_back({a, b, c});
  materials.push_back(material);
  objects.push_back(object);
}

void TriangleMesh::add_quad(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d,
                            Material material, std::uint16_t object) {
  add_triangle(a, b, c, material, object);
  add_triangle(a, c, d, material, object);
}

void TriangleMesh::append(const TriangleMesh& other, const Eigen::Affine3f& T_this_other) {
  const auto offset = static_cast<std::uint32_t>(vertices.size());
  for (const Eigen::Vector3f& v : other.vertices) vertices.push_back(T_this_other * v);
  detail.insert(detail.end(), other.detail.begin(), other.detail.end());
  for (const Triangle& t : other.triangles) {
    triangles.push_back({t[0] + offset, t[1] + offset, t[2] + offset});
  }
  materials.insert(materials.end(), other.materials.begin(), other.materials.end());
  objects.insert(objects.end(), other.objects.begin(), other.objects.end());
}

Eigen::AlignedBox3f TriangleMesh::bounds() const {
  Eigen::AlignedBox3f box;
  for (const Eigen::Vector3f& v : vertices) box.extend(v);
  return box;
}

std::vector<Eigen::Vector3f> vertex_normals(const TriangleMesh& mesh) {
  std::vector<Eigen::Vector3f> normals(mesh.vertices.size(), Eigen::Vector3f::Zero());
  for (const TriangleMesh::Triangle& t : mesh.triangles) {
    const Eigen::Vector3f& a = mesh.vertices[t[0]];
    const Eigen::Vector3f n = (mesh.vertices[t[1]] - a).cross(mesh.vertices[t[2]] - a);
    for (const std::uint32_t index : t) normals[index] += n;
  }
  for (Eigen::Vector3f& n : normals) {
    const float length = n.norm();
    n = length > 0.0F ? Eigen::Vector3f(n / length) : Eigen::Vector3f(Eigen::Vector3f::UnitZ());
  }
  return normals;
}

void write_ply(const TriangleMesh& mesh, const std::filesystem::path& path) {
  std::string bytes = ply_header(mesh);
  bytes.reserve(bytes.size() + 12 * mesh.vertices.size() + 14 * mesh.triangles.size());
  for (const Eigen::Vector3f& v : mesh.vertices) {
    append_bytes(bytes, v.x());
    append_bytes(bytes, v.y());
    append_bytes(bytes, v.z());
  }
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    append_bytes(bytes, std::uint8_t{3});
    for (const std::uint32_t index : mesh.triangles[i])
      append_bytes(bytes, static_cast<std::int32_t>(index));
    append_bytes(bytes, static_cast<std::uint8_t>(mesh.materials[i]));
  }
  std::ofstream file(path, std::ios::binary);
  file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  file.close();
  if (!file) {
    fail_run("{}: cannot write the mesh; check that the folder exists and that disk space is left",
             path.string());
  }
}

}  // namespace apvi::sim
