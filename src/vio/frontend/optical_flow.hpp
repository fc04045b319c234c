// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/types.hpp>
#include <vector>

#include "vio/frontend/frame_image.hpp"

namespace apvi::vio {

/// Positions of the corners in the second image.
struct Flow {
  std::vector<cv::Point2f> to;  ///< [px]
  std::vector<char> found;      ///< 0: no match, or rejected by the forward-backward check
};

/// Pyramidal Lucas-Kanade from `from` in one image to another: first from `guess` on the fine
/// levels only, then, for corners not found, from `second_guess` on all levels. A match must pass
/// the forward-backward check within `max_backward_px` and lie inside the image.
Flow compute_flow(const FrameImage& before, const FrameImage& now,
                  const std::vector<cv::Point2f>& from, const std::vector<cv::Point2f>& guess,
                  const std::vector<cv::Point2f>& second_guess, double max_forward_backward_px);

}  // namespace apvi::vio
