// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <algorithm>
#include <optional>

#include "apvi/geometry/so3.hpp"
#include "doctor/image_pairs.hpp"

namespace apvi::doctor {
namespace {

using Eigen::Vector3d;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

constexpr double kLength = 2.0;         // of a span [s]
constexpr double kCandidateStep = 0.5;  // between the starts of candidates [s]
constexpr double kPairTime = 0.3;       // between the images that are compared [s]
constexpr double kOffsetScale = 0.05;   // time offset that counts as much as one radian [s]
constexpr double kNoise = 0.005;        // of a rotation from a pair of images [rad]

struct Candidate {
  double from = 0.0;
  Matrix6d information = Matrix6d::Zero();
};

// Rotation over the time between two images, and change of the rate: what the mounting and the time
// offset act on.
std::optional<Vector6d> signal_at(const InertialPath& path, double t) {
  const auto before = path.at(t);
  const auto after = path.at(t + kPairTime);
  const auto rate_before = path.rate_at(t);
  const auto rate_after = path.rate_at(t + kPairTime);
  if (!before || !after || !rate_before || !rate_after) return std::nullopt;
  Vector6d signal;
  signal << so3::log(before->R_start_body.conjugate() * after->R_start_body),
      kOffsetScale * (*rate_after - *rate_before);
  return signal;
}

std::optional<Candidate> candidate_at(const InertialPath& path, double from) {
  if (!path.is_continuous(from, from + kLength)) return std::nullopt;
  Candidate candidate{from, Matrix6d::Zero()};
  for (double t = from; t + kPairTime <= from + kLength; t += 0.5 * kPairTime) {
    const auto signal = signal_at(path, t);
    if (signal) candidate.information += *signal * signal->transpose();
  }
  return candidate;
}

}  // namespace

std::vector<TimeSpan> turning_spans(const InertialPath& path, const TimeSpan& within,
                                    std::size_t count) {
  std::vector<Candidate> candidates;
  if (path.empty()) return {};
  const double end = std::min(path.seconds(within.to), path.seconds(path.end()));
  for (double t = std::max(0.0, path.seconds(within.from)); t + kLength <= end;
       t += kCandidateStep) {
    if (const auto candidate = candidate_at(path, t)) candidates.push_back(*candidate);
  }
  Matrix6d known = kNoise * kNoise * Matrix6d::Identity();
  std::vector<double> chosen;
  while (chosen.size() < count && !candidates.empty()) {
    const Matrix6d inverse = known.inverse();
    const auto best = std::max_element(
        candidates.begin(), candidates.end(), [&inverse](const Candidate& a, const Candidate& b) {
          return (inverse * a.information).trace() < (inverse * b.information).trace();
        });
    const double from = best->from;
    known += best->information;
    chosen.push_back(from);
    std::erase_if(candidates,
                  [from](const Candidate& c) { return std::abs(c.from - from) < kLength; });
  }
  std::sort(chosen.begin(), chosen.end());
  std::vector<TimeSpan> spans;
  for (const double from : chosen) {
    const Stamp start = path.start() + Duration::from_seconds(from);
    spans.push_back({start, start + Duration::from_seconds(kLength)});
  }
  return spans;
}

}  // namespace apvi::doctor
