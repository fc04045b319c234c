// SPDX-License-Identifier: BSD-3-Clause
#include "sim/render/ray_caster.hpp"

#include <algorithm>
#include <cstring>
#include <limits>

#include "apvi/core/error.hpp"
#include "sim/render/embree.hpp"

namespace apvi::sim {
namespace {

constexpr float kMinRange = 1e-4F;  // [m]; avoids self-intersection

RTCRay make_ray(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, float max_range) {
  RTCRay ray{};
  ray.org_x = origin.x();
  ray.org_y = origin.y();
  ray.org_z = origin.z();
  ray.tnear = kMinRange;
  ray.dir_x = direction.x();
  ray.dir_y = direction.y();
  ray.dir_z = direction.z();
  ray.tfar = max_range;
  ray.mask = std::numeric_limits<unsigned>::max();
  return ray;
}

RTCScene build_scene(RTCDevice device, const TriangleMesh& mesh) {
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  void* vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                           3 * sizeof(float), mesh.vertices.size());
  void* triangles = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                            sizeof(TriangleMesh::Triangle), mesh.triangles.size());
  if (vertices == nullptr || triangles == nullptr) {
    rtcReleaseGeometry(geometry);
    return nullptr;
  }
  std::memcpy(vertices, mesh.vertices.data(), mesh.vertices.size() * 3 * sizeof(float));
  std::memcpy(triangles, mesh.triangles.data(),
              mesh.triangles.size() * sizeof(TriangleMesh::Triangle));
  rtcCommitGeometry(geometry);
  RTCScene scene = rtcNewScene(device);
  rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);  // watertight at shared edges
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(scene);
  return scene;
}

constexpr std::size_t kPacket = 8;

void load_packet(const RayBatch& rays, std::size_t first, std::size_t count, RTCRayHit8& packet) {
  for (std::size_t k = 0; k < kPacket; ++k) {
    const std::size_t i = first + (k < count ? k : 0);
    packet.ray.org_x[k] = rays.ox[i];
    packet.ray.org_y[k] = rays.oy[i];
    packet.ray.org_z[k] = rays.oz[i];
    packet.ray.tnear[k] = kMinRange;
    packet.ray.dir_x[k] = rays.dx[i];
    packet.ray.dir_y[k] = rays.dy[i];
    packet.ray.dir_z[k] = rays.dz[i];
    packet.ray.time[k] = 0.0F;
    packet.ray.tfar[k] = rays.range[i];
    packet.ray.mask[k] = std::numeric_limits<unsigned>::max();
    packet.ray.id[k] = 0;
    packet.ray.flags[k] = 0;
    packet.hit.geomID[k] = RTC_INVALID_GEOMETRY_ID;
    packet.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
  }
}

void store_packet(const RTCRayHit8& packet, std::size_t first, std::size_t count, RayBatch& rays) {
  for (std::size_t k = 0; k < count; ++k) {
    const bool hit = packet.hit.geomID[k] != RTC_INVALID_GEOMETRY_ID;
    rays.range[first + k] = hit ? packet.ray.tfar[k] : RayBatch::kNoHit;
    rays.u[first + k] = packet.hit.u[k];
    rays.v[first + k] = packet.hit.v[k];
    rays.triangle[first + k] = packet.hit.primID[k];
  }
}

}  // namespace

struct RayCaster::Impl {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  bool packets = false;  // whether the CPU supports 8-ray packets

  Impl() = default;
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    if (scene != nullptr) rtcReleaseScene(scene);
    if (device != nullptr) rtcReleaseDevice(device);
  }

  std::optional<RTCRayHit> intersect(const RTCRay& ray) const {
    RTCRayHit query{};
    query.ray = ray;
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    intersect_ray(scene, query);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
    return query;
  }
};

void RayBatch::resize(std::size_t count) {
  for (auto* lane : {&ox, &oy, &oz, &dx, &dy, &dz, &range, &u, &v}) lane->resize(count);
  triangle.resize(count);
}

RayCaster::RayCaster(const TriangleMesh& mesh) : impl_(std::make_unique<Impl>()) {
  // One thread, so that Embree leaves no worker threads behind; building takes about one second.
  impl_->device = rtcNewDevice("threads=1,set_affinity=0");
  if (impl_->device == nullptr) fail_run("cannot initialize Embree on this machine");
  impl_->scene = build_scene(impl_->device, mesh);
  const RTCError error = rtcGetDeviceError(impl_->device);
  if (error != RTC_ERROR_NONE || impl_->scene == nullptr) {
    fail_run("Embree cannot build a scene of {} triangles (error {}); is there enough memory?",
             mesh.triangles.size(), static_cast<int>(error));
  }
  impl_->packets =
      rtcGetDeviceProperty(impl_->device, RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED) != 0;
}

RayCaster::~RayCaster() = default;
RayCaster::RayCaster(RayCaster&&) noexcept = default;
RayCaster& RayCaster::operator=(RayCaster&&) noexcept = default;

std::optional<Hit> RayCaster::cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                   double max_range) const {
  const auto query = impl_->intersect(
      make_ray(origin.cast<float>(), direction.cast<float>(), static_cast<float>(max_range)));
  if (!query) return std::nullopt;
  Eigen::Vector3d normal(query->hit.Ng_x, query->hit.Ng_y, query->hit.Ng_z);
  normal.normalize();
  if (normal.dot(direction) > 0.0) normal = -normal;
  return Hit{.range = query->ray.tfar, .normal = normal, .triangle = query->hit.primID};
}

void RayCaster::cast(RayBatch& rays) const {
  if (!impl_->packets) {
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const auto query =
          impl_->intersect(make_ray({rays.ox[i], rays.oy[i], rays.oz[i]},
                                    {rays.dx[i], rays.dy[i], rays.dz[i]}, rays.range[i]));
      rays.range[i] = query ? query->ray.tfar : RayBatch::kNoHit;
      rays.u[i] = query ? query->hit.u : 0.0F;
      rays.v[i] = query ? query->hit.v : 0.0F;
      rays.triangle[i] = query ? query->hit.primID : 0;
    }
    return;
  }
  alignas(32) RTCRayHit8 packet{};
  alignas(32) int valid[kPacket];
  for (std::size_t first = 0; first < rays.size(); first += kPacket) {
    const std::size_t count = std::min(kPacket, rays.size() - first);
    for (std::size_t k = 0; k < kPacket; ++k) valid[k] = k < count ? -1 : 0;
    load_packet(rays, first, count, packet);
    intersect_packet(valid, impl_->scene, packet);
    store_packet(packet, first, count, rays);
  }
}

bool RayCaster::occluded(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
                         float max_range) const {
  RTCRay ray = make_ray(origin, direction, max_range);
  occlude_ray(impl_->scene, ray);
  return ray.tfar < 0.0F;
}

}  // namespace apvi::sim
