// SPDX-License-Identifier: BSD-3-Clause
#include "sim/spectral/backscatter_grid.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

#include "sim/spectral/light_field.hpp"
#include "sim/spectral/phase_function.hpp"
#include "sim/world/clones.hpp"

namespace apvi::sim {
namespace {

using Eigen::Vector3f;

// Nodes are dense near the camera, where lamps scatter most: four per octave of t + kFirst.
constexpr float kFirst = 0.125F;  // [m]
constexpr int kPerOctave = 4;
constexpr int kNodes = 37;
constexpr int kSunEvery = 4;            // nodes per shadow ray toward the sun
constexpr float kSunRange = 30.0F;      // [m]
constexpr float kMinLampRange = 0.02F;  // [m]; the size of a lamp

struct NodePlace {
  std::size_t index;
  float fraction;
};

// The exponent and the two leading bits of the mantissa of t + kFirst count the nodes.
NodePlace place_of(float range) {
  const auto bits = std::bit_cast<std::uint32_t>(range + kFirst);
  const std::uint32_t first = std::bit_cast<std::uint32_t>(kFirst) >> 21U;
  const std::uint32_t fraction = bits & 0x1fffffU;
  return {(bits >> 21U) - first, static_cast<float>(fraction) * 0x1.0p-21F};
}

float node_range(int node) {
  const int octave = node / kPerOctave;
  const float mantissa = 1.0F + static_cast<float>(node % kPerOctave) / kPerOctave;
  return std::ldexp(kFirst * mantissa, octave) - kFirst;
}

/// What a band needs besides the geometry.
struct VeilTerms {
  const SeaState* sea;
  SpectrumF strength{};  ///< pi b
  std::array<SpectrumF, 3> response{};
  std::size_t lamps = 0;
};

/// One step along a ray.
struct VeilStep {
  float along = 0.0F, length = 0.0F, depth = 0.0F;
  float sun = 0.0F, sky = 0.0F;  ///< scattered per unit of direct and diffuse irradiance
  std::array<float, 2> lamp{};   ///< scattered per unit of irradiance at 1 m
  std::array<float, 2> lamp_range{};
};

APVI_CLONES void add_daylight(const SeaState& sea, const SpectrumF& strength, const VeilStep& step,
                              float* sum) {
#pragma GCC ivdep
  for (std::size_t k = 0; k < kBands; ++k) {
    const float total = sea.total[k] * fast_exp(-sea.diffuse[k] * step.depth);
    const float sun = sea.sun[k] * fast_exp(-sea.sun_decay[k] * step.depth);
    const float source = step.sky * (total - sun) + step.sun * sun;
    sum[k] += strength[k] * step.length * source * fast_exp(-sea.smooth[k] * step.along);
  }
}

APVI_CLONES void add_lamplight(const SpectrumF& smooth, const SpectrumF& strength,
                               const SpectrumF& lamp, float weight, float path, float* sum) {
#pragma GCC ivdep
  for (std::size_t k = 0; k < kBands; ++k)
    sum[k] += strength[k] * weight * lamp[k] * fast_exp(-smooth[k] * path);
}

void add_step(const VeilTerms& terms, const VeilStep& step, float* sum) {
  const SeaState& sea = *terms.sea;
  add_daylight(sea, terms.strength, step, sum);
  for (std::size_t i = 0; i < terms.lamps; ++i)
    add_lamplight(sea.smooth, terms.strength, sea.lamps[i], step.length * step.lamp[i],
                  step.along + step.lamp_range[i], sum);
}

void project(const VeilTerms& terms, const float* sum, float* raw) {
  for (std::size_t c = 0; c < 3; ++c) {
    float value = 0.0F;
    for (std::size_t k = 0; k < kBands; ++k) value += terms.response[c][k] * sum[k];
    raw[c] = value;
  }
}

void add_lamp(const LampPose& pose, const LampLobe& lobe, const Vector3f& p, const Vector3f& view,
              std::size_t i, VeilStep& step) {
  const Vector3f ray = p - pose.position;
  const float range = std::max(kMinLampRange, ray.norm());
  const Vector3f travel = ray / range;
  step.lamp_range[i] = range;
  step.lamp[i] =
      lobe.at(travel.dot(pose.axis)) * wide_phase().at(-travel.dot(view)) / (range * range);
}

/// Integrates along single rays.
class Integrator {
 public:
  Integrator(const Sea& sea, const SeaState& state, const std::vector<LampPose>& lamps,
             const RayCaster& world)
      : lobes_(sea.lobes()), lamps_(lamps), world_(world) {
    terms_.sea = &state;
    terms_.lamps = std::min(lamps.size(), state.lamps.size());
    for (std::size_t k = 0; k < kBands; ++k)
      terms_.strength[k] = std::numbers::pi_v<float> * state.scatter[k];
    for (std::size_t c = 0; c < 3; ++c) terms_.response[c] = to_float(sea.sensor().response[c]);
  }

  /// `profile`: 3 raw values at each of the kNodes nodes; all 0 for a view of 0.
  void run(const Vector3f& origin, const Vector3f& view, float* profile) const {
    std::fill_n(profile, 3 * kNodes, 0.0F);
    if (view.isZero()) return;
    std::array<float, kBands> sum{};
    bool lit = false;
    for (int n = 0; n + 1 < kNodes; ++n) {
      VeilStep step;
      step.length = node_range(n + 1) - node_range(n);
      step.along = node_range(n) + 0.5F * step.length;
      const Vector3f p = origin + step.along * view;
      step.depth = -p.z();
      if (n % kSunEvery == 0) lit = sees_sun(p);
      if (step.depth > 0.0F) {
        scatter(p, view, lit, step);
        add_step(terms_, step, sum.data());
      }
      project(terms_, sum.data(), profile + 3 * static_cast<std::ptrdiff_t>(n + 1));
    }
  }

 private:
  bool sees_sun(const Vector3f& p) const {
    const SeaState& sea = *terms_.sea;
    const bool shines = *std::max_element(sea.sun.begin(), sea.sun.end()) > 0.0F;
    return shines && !world_.occluded(p, sea.sun_direction, kSunRange);
  }
  void scatter(const Vector3f& p, const Vector3f& view, bool lit, VeilStep& step) const {
    const Vector3f& sun = terms_.sea->sun_direction;
    if (lit) step.sun = wide_phase().at(sun.dot(view)) / sun.z();
    step.sky = diffuse_scatter().at(view.z());
    for (std::size_t i = 0; i < terms_.lamps; ++i) add_lamp(lamps_[i], lobes_[i], p, view, i, step);
  }

  VeilTerms terms_;
  const std::vector<LampLobe>& lobes_;
  const std::vector<LampPose>& lamps_;
  const RayCaster& world_;
};

}  // namespace

float BackscatterGrid::max_range() {
  return node_range(kNodes - 1);
}

BackscatterGrid::BackscatterGrid(const Lens& lens, int step, const SE3& T_world_camera,
                                 const Sea& sea, const SeaState& state,
                                 const std::vector<LampPose>& lamps, const RayCaster& world)
    : step_(step),
      columns_((lens.width - 2 + step) / step + 1),
      rows_((lens.height - 2 + step) / step + 1),
      image_(lens.width, lens.height),
      profiles_(static_cast<std::size_t>(columns_ * rows_)) {
  const Integrator integrator(sea, state, lamps, world);
  const Eigen::Matrix3f R = T_world_camera.rotation.toRotationMatrix().cast<float>();
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      const std::size_t pixel = lens.index(std::min(column * step_, lens.width - 1),
                                           std::min(row * step_, lens.height - 1));
      Vector3f origin = T_world_camera.translation.cast<float>();
      if (!lens.origins.empty()) origin += R * lens.origins[pixel];
      integrator.run(origin, R * lens.rays[pixel], profiles_[vertex(column, row)].data());
    }
  }
}

Vector3f BackscatterGrid::at(int x, int y, float range) const {
  const Profile& profile = profiles_[vertex(std::min((x + step_ / 2) / step_, columns_ - 1),
                                            std::min((y + step_ / 2) / step_, rows_ - 1))];
  const NodePlace place = place_of(std::clamp(range, 0.0F, 0.999F * max_range()));
  const float* low = &profile[3 * place.index];
  Vector3f scattered;
  for (int c = 0; c < 3; ++c) scattered[c] = low[c] + place.fraction * (low[c + 3] - low[c]);
  return scattered;
}

void BackscatterGrid::add_to(const cv::Rect& area, TileRays& tile) const {
  const float end = 0.999F * max_range();
  for (int i = 0; i < area.area(); ++i) {
    const int x = area.x + i % area.width;
    const int y = area.y + i / area.width;
    const int column = std::min(x / step_, columns_ - 2);
    const int row = std::min(y / step_, rows_ - 2);
    const int right = std::min((column + 1) * step_, image_.width - 1);
    const int below = std::min((row + 1) * step_, image_.height - 1);
    const float u =
        static_cast<float>(x - column * step_) / static_cast<float>(right - column * step_);
    const float v = static_cast<float>(y - row * step_) / static_cast<float>(below - row * step_);
    const float range = tile.rays.range[static_cast<std::size_t>(i)];
    const NodePlace place = place_of(range < 0.0F ? end : std::min(range, end));
    const float weights[] = {(1.0F - u) * (1.0F - v), u * (1.0F - v), (1.0F - u) * v, u * v};
    const Profile* corners[] = {
        &profiles_[vertex(column, row)], &profiles_[vertex(column + 1, row)],
        &profiles_[vertex(column, row + 1)], &profiles_[vertex(column + 1, row + 1)]};
    float scattered[3] = {};
    for (int k = 0; k < 4; ++k) {
      const float* low = &(*corners[k])[3 * place.index];
      for (int c = 0; c < 3; ++c)
        scattered[c] += weights[k] * (low[c] + place.fraction * (low[c + 3] - low[c]));
    }
    for (int c = 0; c < 3; ++c) tile.observed[c][i] += scattered[c];
  }
}

}  // namespace apvi::sim
