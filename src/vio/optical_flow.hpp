// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/types.hpp>
#include <vector>

#include "vio/frame_image.hpp"

namespace apvi::vio {

/// Where corners of one image are in another.
struct Flow {
  std::vector<cv::Point2f> to;  ///< [px]
  std::vector<char> found;      ///< 0: no match, or it does not lead back
};

/// Pyramidal Lucas-Kanade from `from` in one image to another: first from `guess` on the fine
/// levels alone, then from `second_guess` on all levels for those that this does not find. A match
/// counts when the flow back ends within `max_backward_px` of where it began, and inside of the
/// image.
Flow follow(const FrameImage& before, const FrameImage& now, const std::vector<cv::Point2f>& from,
            const std::vector<cv::Point2f>& guess, const std::vector<cv::Point2f>& second_guess,
            double max_backward_px);

}  // namespace apvi::vio
