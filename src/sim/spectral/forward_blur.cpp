// SPDX-License-Identifier: BSD-3-Clause
#include "sim/spectral/forward_blur.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <vector>

#include "sim/spectral/phase_function.hpp"
#include "sim/world/clones.hpp"

namespace apvi::sim {
namespace {

constexpr std::size_t kClasses = 3;
constexpr std::size_t kLevels = kClasses + 1;
constexpr double kMaxScatterings = 6.0;

/// An image of one width of the blur, with pixels as large as that width allows.
struct Level {
  double sigma = 1.0;  ///< [px] of the full image
  int step = 1;        ///< [px] of the full image per pixel
  cv::Mat light{};
};

std::array<Level, kLevels> make_levels(const ForwardBlur& blur, const cv::Size& size) {
  std::array<Level, kLevels> levels;
  for (std::size_t j = 0; j < kLevels; ++j) {
    const AngleClass& angles = small_angle_classes()[std::min(j, kClasses - 1)];
    const double times = j < kClasses ? 1.0 : kMaxScatterings;
    levels[j].sigma = blur.focal_px * angles.rms * std::sqrt(times / 3.0);
    levels[j].step = std::clamp(static_cast<int>(levels[j].sigma / 1.5), 1, 8);
    const int step = levels[j].step;
    levels[j].light =
        cv::Mat::zeros({(size.width + step - 1) / step, (size.height + step - 1) / step}, CV_32FC3);
  }
  return levels;
}

// Shares of the levels in light that was scattered that many times.
std::array<float, kLevels> shares_of(const std::array<Level, kLevels>& levels, double times) {
  std::array<float, kLevels> shares{};
  double all = 0.0;
  for (const AngleClass& angles : small_angle_classes()) all += angles.fraction;
  for (std::size_t j = 0; j < kClasses; ++j) {
    const double low = levels[j].sigma * levels[j].sigma;
    const double high = levels[j + 1].sigma * levels[j + 1].sigma;
    const double upper = std::clamp((times - 1.0) * low / (high - low), 0.0, 1.0);
    const double fraction = small_angle_classes()[j].fraction / all;
    shares[j] += static_cast<float>((1.0 - upper) * fraction);
    shares[j + 1] += static_cast<float>(upper * fraction);
  }
  return shares;
}

/// Shares by the scattering depth, tabulated.
class ShareTable {
 public:
  explicit ShareTable(const std::array<Level, kLevels>& levels) {
    for (std::size_t i = 0; i < kSteps; ++i)
      shares_[i] = shares_of(
          levels, std::min(kMaxScatterings, mean_scatterings(static_cast<double>(i) * kStep)));
  }
  const std::array<float, kLevels>& at(float tau) const {
    return shares_[std::min(kSteps - 1, static_cast<std::size_t>(tau * (1.0F / kStep) + 0.5F))];
  }

 private:
  static constexpr std::size_t kSteps = 256;
  static constexpr float kStep = 0.03F;
  std::array<std::array<float, kLevels>, kSteps> shares_{};
};

void distribute(const ForwardBlur& blur, const cv::Mat& light, const cv::Mat& range,
                std::array<Level, kLevels>& levels) {
  const ShareTable table(levels);
  const auto scattering = static_cast<float>(blur.scattering);
  for (int y = 0; y < light.rows; ++y) {
    for (int x = 0; x < light.cols; ++x) {
      const float r = range.at<float>(y, x);
      if (r <= 0.0F) continue;
      const auto& shares = table.at(scattering * r);
      const cv::Vec3f amount = light.at<cv::Vec3f>(y, x);
      for (std::size_t j = 0; j < kLevels; ++j) {
        const int step = levels[j].step;
        levels[j].light.at<cv::Vec3f>(y / step, x / step) += shares[j] * amount;
      }
    }
  }
}

// The last pixels of a level may stand for fewer pixels of the image than the others.
void complete_borders(const cv::Size& size, Level& level) {
  const auto part = [&](int count) {
    const int rest = count % level.step;
    return rest == 0 ? 1.0F : static_cast<float>(level.step) / static_cast<float>(rest);
  };
  for (int y = 0; y < level.light.rows; ++y)
    level.light.at<cv::Vec3f>(y, level.light.cols - 1) *= part(size.width);
  for (int x = 0; x < level.light.cols; ++x)
    level.light.at<cv::Vec3f>(level.light.rows - 1, x) *= part(size.height);
}

std::vector<float> gaussian_kernel(double sigma) {
  const int reach = std::max(1, static_cast<int>(std::ceil(3.0 * sigma)));
  std::vector<float> kernel;
  double sum = 0.0;
  for (int i = -reach; i <= reach; ++i) {
    const double value = std::exp(-0.5 * i * i / (sigma * sigma));
    kernel.push_back(static_cast<float>(value));
    sum += value;
  }
  for (float& value : kernel) value = static_cast<float>(static_cast<double>(value) / sum);
  return kernel;
}

APVI_CLONES void add_scaled(const float* in, float weight, float* out, int count) {
  for (int i = 0; i < count; ++i) out[i] += weight * in[i];
}

// Divides the columns by the weights of the kernel that lie inside the image.
void even_out(const std::vector<float>& kernel, cv::Mat& image) {
  const int reach = static_cast<int>(kernel.size() / 2);
  for (int x = 0; x < image.cols; ++x) {
    float inside = 0.0F;
    for (int shift = -reach; shift <= reach; ++shift)
      if (x - shift >= 0 && x - shift < image.cols)
        inside += kernel[static_cast<std::size_t>(shift + reach)];
    for (int y = 0; y < image.rows; ++y) image.at<cv::Vec3f>(y, x) /= inside;
  }
}

cv::Mat convolve_rows(const cv::Mat& image, const std::vector<float>& kernel) {
  cv::Mat out = cv::Mat::zeros(image.size(), image.type());
  const int reach = static_cast<int>(kernel.size() / 2);
  for (int y = 0; y < image.rows; ++y) {
    for (int shift = -reach; shift <= reach; ++shift) {
      const int count = image.cols - std::abs(shift);
      if (count <= 0) continue;
      add_scaled(image.ptr<float>(y, std::max(0, -shift)),
                 kernel[static_cast<std::size_t>(shift + reach)],
                 out.ptr<float>(y, std::max(0, shift)), 3 * count);
    }
  }
  even_out(kernel, out);
  return out;
}

cv::Mat spread(const cv::Mat& image, double sigma) {
  const std::vector<float> kernel = gaussian_kernel(sigma);
  cv::Mat turned;
  cv::transpose(convolve_rows(image, kernel), turned);
  cv::Mat out;
  cv::transpose(convolve_rows(turned, kernel), out);
  return out;
}

/// Where a pixel of the full image lies between the pixels of a smaller one.
struct Between {
  int low;
  int high;
  float part;
};

Between between(int at, int step, int size) {
  const float x = (static_cast<float>(at) + 0.5F) / static_cast<float>(step) - 0.5F;
  const float inside = std::clamp(x, 0.0F, static_cast<float>(size - 1));
  const int low = static_cast<int>(inside);
  return {low, std::min(low + 1, size - 1), inside - static_cast<float>(low)};
}

// Adds the small image, interpolated linearly, and scaled from the sum to the mean of its pixels.
void add_enlarged(const cv::Mat& small, int step, cv::Mat& image) {
  const float share = 1.0F / static_cast<float>(step * step);
  std::vector<Between> columns;
  for (int x = 0; x < image.cols; ++x) columns.push_back(between(x, step, small.cols));
  for (int y = 0; y < image.rows; ++y) {
    const Between row = between(y, step, small.rows);
    const auto* top = small.ptr<cv::Vec3f>(row.low);
    const auto* bottom = small.ptr<cv::Vec3f>(row.high);
    auto* out = image.ptr<cv::Vec3f>(y);
    for (int x = 0; x < image.cols; ++x) {
      const auto [low, high, part] = columns[static_cast<std::size_t>(x)];
      const cv::Vec3f above = (1.0F - part) * top[low] + part * top[high];
      const cv::Vec3f below = (1.0F - part) * bottom[low] + part * bottom[high];
      out[x] += share * ((1.0F - row.part) * above + row.part * below);
    }
  }
}

}  // namespace

double mean_scatterings(double tau) {
  return tau < 1e-6 ? 1.0 : tau / (1.0 - std::exp(-tau));
}

void add_forward_blur(const ForwardBlur& blur, const cv::Mat& light, const cv::Mat& range,
                      cv::Mat& image) {
  std::array<Level, kLevels> levels = make_levels(blur, light.size());
  distribute(blur, light, range, levels);
  for (Level& level : levels) {
    complete_borders(light.size(), level);
    add_enlarged(spread(level.light, level.sigma / level.step), level.step, image);
  }
}

}  // namespace apvi::sim
