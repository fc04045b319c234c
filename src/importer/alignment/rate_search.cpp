// SPDX-License-Identifier: BSD-3-Clause
#include "importer/alignment/rate_search.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>

namespace apvi::importer {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kMaxGap_s = 0.25;      // between samples, over which rates are interpolated
constexpr double kPairTime_s = 0.3;     // between the images that `camera_rates` compares
constexpr double kSharedShare = 0.6;    // of the camera's rates must be within the log,
constexpr double kSharedTime_s = 20.0;  // and so much of them,
constexpr double kEnoughShare = 0.95;   // or nearly all
constexpr double kSameTime_s = 1.0;     // nearer peaks are told apart by the images later
constexpr double kNoise = 0.005;        // of a rate that is hardly seen [rad/s]

// A sequence for correlations by the Fourier transform.
class Spectrum {
 public:
  Spectrum(std::size_t size, const RateGrid& grid, auto&& value) {
    cv::Mat values = cv::Mat::zeros(1, static_cast<int>(size), CV_64F);
    for (std::size_t i = 0; i < grid.rates.size(); ++i) {
      if (grid.known[i]) values.at<double>(static_cast<int>(i)) = value(grid.rates[i]);
    }
    cv::dft(values, spectrum_);
  }
  // Sums of this times `other` that many places later.
  cv::Mat correlate(const Spectrum& other) const {
    cv::Mat product;
    cv::mulSpectrums(other.spectrum_, spectrum_, product, 0, /*conjB=*/true);
    cv::Mat sums;
    cv::idft(product, sums, cv::DFT_SCALE | cv::DFT_REAL_OUTPUT);
    return sums;
  }

 private:
  cv::Mat spectrum_;
};

constexpr std::size_t kSquares = 6;
using Pair = std::pair<Eigen::Index, Eigen::Index>;
constexpr std::array<Pair, kSquares> kSquareAxes = {
    {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {0, 2}, {1, 2}}};

struct Spectra {
  Spectra(std::size_t size, const RateGrid& grid)
      : known(size, grid, [](const Vector3d&) { return 1.0; }) {
    for (Eigen::Index axis = 0; axis < 3; ++axis)
      axes.emplace_back(size, grid, [&](const Vector3d& w) { return w(axis); });
    for (const Pair& of : kSquareAxes)
      squares.emplace_back(size, grid,
                           [&](const Vector3d& w) { return w(of.first) * w(of.second); });
  }
  Spectrum known;
  std::vector<Spectrum> axes;
  std::vector<Spectrum> squares;
};

// Second moments of the rates that camera and gyro share, about their means.
struct Moments {
  double count = 0.0;
  Matrix3d camera;
  Matrix3d gyro;
  Matrix3d both;  // camera by gyro
};

// Sums over those rates, for every lag.
class SharedSums {
 public:
  SharedSums(const RateGrid& camera, const RateGrid& gyro)
      : size_(static_cast<std::size_t>(
            cv::getOptimalDFTSize(static_cast<int>(camera.rates.size() + gyro.rates.size())))) {
    const Spectra a(size_, camera);
    const Spectra b(size_, gyro);
    count_ = a.known.correlate(b.known);
    for (std::size_t i = 0; i < 3; ++i) {
      camera_.push_back(a.axes[i].correlate(b.known));
      gyro_.push_back(a.known.correlate(b.axes[i]));
      for (std::size_t k = 0; k < 3; ++k) both_.push_back(a.axes[i].correlate(b.axes[k]));
    }
    for (std::size_t i = 0; i < kSquares; ++i) {
      camera_squares_.push_back(a.squares[i].correlate(b.known));
      gyro_squares_.push_back(a.known.correlate(b.squares[i]));
    }
  }

  double count(int lag) const { return std::round(at(count_, lag)); }

  Moments moments(int lag) const {
    Moments m;
    m.count = std::max(1.0, count(lag));
    const Vector3d camera(at(camera_[0], lag), at(camera_[1], lag), at(camera_[2], lag));
    const Vector3d gyro(at(gyro_[0], lag), at(gyro_[1], lag), at(gyro_[2], lag));
    for (std::size_t i = 0; i < kSquares; ++i) {
      const auto& [row, column] = kSquareAxes[i];
      m.camera(row, column) = m.camera(column, row) = at(camera_squares_[i], lag);
      m.gyro(row, column) = m.gyro(column, row) = at(gyro_squares_[i], lag);
    }
    for (std::size_t i = 0; i < 9; ++i)
      m.both(static_cast<Eigen::Index>(i / 3), static_cast<Eigen::Index>(i % 3)) =
          at(both_[i], lag);
    m.camera -= camera * camera.transpose() / m.count;
    m.gyro -= gyro * gyro.transpose() / m.count;
    m.both -= camera * gyro.transpose() / m.count;
    return m;
  }

 private:
  double at(const cv::Mat& sums, int lag) const {
    return sums.at<double>(lag >= 0 ? lag : lag + static_cast<int>(size_));
  }

  std::size_t size_;
  cv::Mat count_;
  std::vector<cv::Mat> camera_;
  std::vector<cv::Mat> gyro_;
  std::vector<cv::Mat> both_;
  std::vector<cv::Mat> camera_squares_;
  std::vector<cv::Mat> gyro_squares_;
};

// Product of 1 - r² over the canonical correlations r: the share of the camera's rates, as a
// volume, that the gyro does not explain.
double unexplained(const Moments& m) {
  const Matrix3d noise = m.count * kNoise * kNoise * Matrix3d::Identity();
  const Matrix3d by_camera = (m.camera + noise).ldlt().solve(m.both);
  const Matrix3d by_gyro = (m.gyro + noise).ldlt().solve(m.both.transpose());
  const double share = (Matrix3d::Identity() - by_camera * by_gyro).determinant();
  return std::clamp(share, 1e-6, 1.0);
}

// Wahba's problem (Markley, "Attitude determination using vector observations and the singular
// value decomposition", 1988).
Eigen::Quaterniond best_rotation(const Matrix3d& camera_by_gyro) {
  const Eigen::JacobiSVD<Matrix3d> svd(camera_by_gyro, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Vector3d signs = Vector3d::Ones();
  signs.z() = svd.matrixU().determinant() * svd.matrixV().determinant();
  const Matrix3d R = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  return Eigen::Quaterniond(R).normalized();
}

struct Lags {
  int first = 0;
  std::vector<double> correlation;  // zero where too little is shared
  std::vector<double> evidence;     // logarithm of the likelihood ratio per independent rate

  double lag_s(std::size_t i) const { return kRateStep_s * (first + static_cast<double>(i)); }
};

Lags correlate(const SharedSums& sums, const RateGrid& camera, const RateGrid& gyro) {
  const auto all = static_cast<double>(camera.count_known());
  const double needed =
      std::max(kSharedShare * all, std::min(kEnoughShare * all, kSharedTime_s / kRateStep_s));
  Lags lags;
  lags.first = 1 - static_cast<int>(camera.rates.size());
  for (int lag = lags.first; lag < static_cast<int>(gyro.rates.size()); ++lag) {
    const double count = sums.count(lag);
    const double left = count < needed ? 1.0 : unexplained(sums.moments(lag));
    lags.correlation.push_back(std::sqrt(1.0 - left));
    lags.evidence.push_back(-0.5 * count * std::log(left));
  }
  return lags;
}

// Time over which the rates of a camera change: twice that after which their autocorrelation is one
// half, about the axis with the slowest changes [steps].
double correlation_time(const RateGrid& grid) {
  Vector3d mean = Vector3d::Zero();
  for (const Vector3d& rate : grid.rates) mean += rate;
  mean /= static_cast<double>(std::max<std::size_t>(1, grid.count_known()));
  const auto covariance = [&](std::size_t later) {
    Matrix3d sum = Matrix3d::Zero();
    double count = 0.0;
    for (std::size_t i = 0; i + later < grid.rates.size(); ++i) {
      if (!grid.known[i] || !grid.known[i + later]) continue;
      sum += (grid.rates[i] - mean) * (grid.rates[i + later] - mean).transpose();
      count += 1.0;
    }
    return Matrix3d(sum / std::max(1.0, count));
  };
  const Matrix3d noise = kNoise * kNoise * Matrix3d::Identity();
  const Matrix3d L_inverse = Matrix3d((covariance(0) + noise).llt().matrixL()).inverse();
  const auto slowest = [&](std::size_t later) {
    const Matrix3d c = L_inverse * covariance(later) * L_inverse.transpose();
    return Eigen::SelfAdjointEigenSolver<Matrix3d>(0.5 * (c + c.transpose())).eigenvalues()(2);
  };
  std::size_t later = 1;
  while (later < grid.rates.size() && slowest(later) > 0.5) ++later;
  return std::max(kPairTime_s / kRateStep_s, 2.0 * static_cast<double>(later));
}

// What the best of so many independent lags reaches by chance: twice the evidence of nine
// correlations is a chi-squared variable of nine degrees of freedom (Bartlett), whose upper tail is
// x^3.5 exp(-x) / gamma(4.5) of its half.
double evidence_by_chance(double lags) {
  constexpr double kMean = 4.5;
  double x = kMean + std::log(lags);
  for (int i = 0; i < 5; ++i) x = std::log(lags) + 3.5 * std::log(x) - std::lgamma(kMean);
  return std::max(kMean, x);
}

// Whether a lag is of another peak, and not of the slope of this one.
std::vector<bool> elsewhere(const std::vector<double>& evidence, std::size_t peak) {
  std::vector<bool> other(evidence.size(), true);
  const auto leave = [&](std::ptrdiff_t step) {
    auto i = static_cast<std::ptrdiff_t>(peak);
    const auto end = static_cast<std::ptrdiff_t>(evidence.size());
    for (double walked = 0.0; i >= 0 && i < end; i += step, walked += kRateStep_s) {
      const auto at = static_cast<std::size_t>(i);
      const auto before = static_cast<std::size_t>(i - step);
      if (walked > kSameTime_s && evidence[at] > evidence[before]) break;
      other[at] = false;
    }
  };
  leave(1);
  leave(-1);
  return other;
}

// Integral of a gyro's rates, which for small angles is the rotation vector.
class GyroIntegral {
 public:
  explicit GyroIntegral(const std::vector<ImuSample>& imu) : imu_(imu) {
    for (std::size_t i = 1; i < imu.size(); ++i) {
      const double dt = seconds_between(imu[i - 1].stamp, imu[i].stamp);
      const bool is_gap = dt > kMaxGap_s;
      const Vector3d turned = 0.5 * dt * (imu[i - 1].gyro + imu[i].gyro);
      angles_.emplace_back(angles_.back() + (is_gap ? Vector3d(Vector3d::Zero()) : turned));
      gaps_.push_back(gaps_.back() + (is_gap ? 1 : 0));
    }
  }

  // A time that only goes forward.
  class Place {
   public:
    explicit Place(const GyroIntegral& of) : of_(of) {}
    // False outside the log and in its gaps.
    bool go_to(Stamp stamp) {
      const std::vector<ImuSample>& imu = of_.imu_;
      while (next_ < imu.size() && imu[next_].stamp < stamp) ++next_;
      if (next_ == 0 || next_ == imu.size() || of_.gaps_[next_ - 1] != of_.gaps_[next_])
        return false;
      const Stamp before = imu[next_ - 1].stamp;
      const double u = seconds_between(before, stamp) / seconds_between(before, imu[next_].stamp);
      angle_ = of_.angles_[next_ - 1] + u * (of_.angles_[next_] - of_.angles_[next_ - 1]);
      return true;
    }
    const Vector3d& angle() const { return angle_; }
    int gaps() const { return of_.gaps_[next_]; }  // before it

   private:
    const GyroIntegral& of_;
    std::size_t next_ = 0;
    Vector3d angle_ = Vector3d::Zero();
  };

 private:
  const std::vector<ImuSample>& imu_;
  std::vector<Vector3d> angles_ = {Vector3d::Zero()};
  std::vector<int> gaps_ = {0};
};

}  // namespace

std::size_t RateGrid::count_known() const {
  return static_cast<std::size_t>(std::count(known.begin(), known.end(), true));
}

double RateGrid::variation() const {
  Vector3d sum = Vector3d::Zero();
  double squares = 0.0;
  for (const Vector3d& rate : rates) {
    sum += rate;
    squares += rate.squaredNorm();
  }
  const auto n = static_cast<double>(std::max<std::size_t>(1, count_known()));
  return std::sqrt(std::max(0.0, squares / n - (sum / n).squaredNorm()));
}

RateGrid rate_grid(const std::vector<doctor::CameraRate>& rates) {
  RateGrid grid;
  if (rates.empty()) return grid;
  grid.start = rates.front().stamp;
  std::size_t next = 0;
  for (double t = 0.0; true; t += kRateStep_s) {
    const Stamp stamp = grid.start + Duration::from_seconds(t);
    while (next < rates.size() && rates[next].stamp < stamp) ++next;
    if (next == rates.size()) break;
    const doctor::CameraRate& after = rates[next];
    const doctor::CameraRate& before = rates[next == 0 ? 0 : next - 1];
    const double gap = seconds_between(before.stamp, after.stamp);
    const double u = gap > 0.0 ? seconds_between(before.stamp, stamp) / gap : 0.0;
    const bool is_known = gap <= kMaxGap_s;
    grid.known.push_back(is_known);
    grid.rates.push_back(is_known ? Vector3d(before.rate + u * (after.rate - before.rate))
                                  : Vector3d(Vector3d::Zero()));
  }
  return grid;
}

RateGrid rate_grid(const std::vector<ImuSample>& imu) {
  RateGrid grid;
  if (imu.size() < 2) return grid;
  grid.start = imu.front().stamp;
  const GyroIntegral integral(imu);
  GyroIntegral::Place early(integral);
  GyroIntegral::Place late(integral);
  const Duration half = Duration::from_seconds(0.5 * kPairTime_s);
  for (double t = 0.0; true; t += kRateStep_s) {
    const Stamp stamp = grid.start + Duration::from_seconds(t);
    if (imu.back().stamp < stamp) break;
    const bool is_known =
        early.go_to(stamp - half) && late.go_to(stamp + half) && early.gaps() == late.gaps();
    grid.known.push_back(is_known);
    grid.rates.emplace_back(Vector3d::Zero());
    if (is_known) grid.rates.back() = (late.angle() - early.angle()) / kPairTime_s;
  }
  return grid;
}

std::optional<RateMatch> match_rates(const RateGrid& camera, const RateGrid& gyro,
                                     std::optional<std::pair<double, double>> within) {
  if (camera.count_known() < 2 || gyro.count_known() < 2) return std::nullopt;
  const SharedSums sums(camera, gyro);
  Lags lags = correlate(sums, camera, gyro);
  double possible = 0.0;
  for (std::size_t i = 0; i < lags.correlation.size(); ++i) {
    if (within && (lags.lag_s(i) < within->first || lags.lag_s(i) > within->second))
      lags.correlation[i] = lags.evidence[i] = 0.0;
    if (lags.evidence[i] > 0.0) possible += 1.0;
  }
  const auto peak = static_cast<std::size_t>(
      std::max_element(lags.evidence.begin(), lags.evidence.end()) - lags.evidence.begin());
  if (!(lags.evidence[peak] > 0.0)) return std::nullopt;
  RateMatch match;
  match.lag_s = lags.lag_s(peak);
  match.correlation = lags.correlation[peak];
  match.R_camera_body = best_rotation(sums.moments(lags.first + static_cast<int>(peak)).both);
  const double width = correlation_time(camera);
  const std::vector<bool> other = elsewhere(lags.evidence, peak);
  double rival = evidence_by_chance(1.0 + possible / width);
  for (std::size_t i = 0; i < other.size(); ++i) {
    if (!other[i]) continue;
    match.elsewhere = std::max(match.elsewhere, lags.correlation[i]);
    rival = std::max(rival, lags.evidence[i] / width);
  }
  const double better = 2.0 * (lags.evidence[peak] / width - rival);
  match.sigmas = better > 0.0 ? std::sqrt(better) : -std::sqrt(-better);
  return match;
}

}  // namespace apvi::importer
