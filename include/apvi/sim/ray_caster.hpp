// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "apvi/sim/mesh.hpp"

namespace apvi::sim {

struct Hit {
  double range = 0.0;                                ///< from the origin to the surface [m]
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();  ///< of the facet, unit, towards the origin
  std::uint32_t triangle = 0;
};

/// Many rays at once, as structure of arrays; `cast` fills the second half.
struct RayBatch {
  std::vector<float> ox, oy, oz;  ///< origins, world [m]
  std::vector<float> dx, dy, dz;  ///< directions, unit
  std::vector<float> range;       ///< in: farthest [m]; out: to the hit, kNoHit where there is none
  std::vector<float> u, v;        ///< barycentric coordinates of the triangle's corners 1 and 2
  std::vector<std::uint32_t> triangle;

  static constexpr float kNoHit = -1.0F;
  void resize(std::size_t count);
  std::size_t size() const { return ox.size(); }
};

/// Ray casting against a mesh (Embree). Safe to use from any number of threads.
class RayCaster {
 public:
  /// Copies what it needs. Throws RunError when Embree cannot be started or memory is short.
  explicit RayCaster(const TriangleMesh& mesh);
  ~RayCaster();
  RayCaster(RayCaster&&) noexcept;
  RayCaster& operator=(RayCaster&&) noexcept;

  /// First surface along a unit `direction`, of either side, no farther than `max_range` [m].
  std::optional<Hit> cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                          double max_range) const;
  /// The same for a batch of neighbouring rays, several at a time.
  void cast(RayBatch& rays) const;
  /// Whether anything lies within `max_range` along the ray.
  bool occluded(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
                float max_range) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace apvi::sim
