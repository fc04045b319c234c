// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "sim/world/mesh.hpp"

namespace apvi::sim {

struct Hit {
  double range = 0.0;                                ///< from the origin to the surface [m]
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  ///< of the facet, unit, toward the origin
  std::uint32_t triangle = 0;
};

/// A batch of rays as a structure of arrays; `cast` fills range, u, v and triangle.
struct RayBatch {
  std::vector<float> ox, oy, oz;  ///< origins, world [m]
  std::vector<float> dx, dy, dz;  ///< directions, unit
  std::vector<float> range;       ///< in: maximum [m]; out: range of the hit, or kNoHit
  std::vector<float> u, v;        ///< barycentric coordinates of the triangle's corners 1 and 2
  std::vector<std::uint32_t> triangle;

  static constexpr float kNoHit = -1.0F;
  void resize(std::size_t count);
  std::size_t size() const { return ox.size(); }
};

/// Ray casting against a mesh (Embree). Thread-safe.
class RayCaster {
 public:
  /// Copies the mesh data. Throws RunError when Embree cannot be initialized or memory runs out.
  explicit RayCaster(const TriangleMesh& mesh);
  ~RayCaster();
  RayCaster(RayCaster&&) noexcept;
  RayCaster& operator=(RayCaster&&) noexcept;

  /// First surface (front or back side) along a unit `direction` within `max_range` [m].
  std::optional<Hit> cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                          double max_range) const;
  /// As above for a batch of neighboring rays, several at a time (packet tracing).
  void cast(RayBatch& rays) const;
  /// Whether any surface lies within `max_range` along the ray.
  bool occluded(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
                float max_range) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace apvi::sim
