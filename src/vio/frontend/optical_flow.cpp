// SPDX-License-Identifier: BSD-3-Clause
#include "vio/frontend/optical_flow.hpp"

#include <opencv2/video/tracking.hpp>

namespace apvi::vio {
namespace {

using Points = std::vector<cv::Point2f>;

constexpr int kFineLevels = 1;

std::vector<uchar> lucas_kanade(const FrameImage& a, const FrameImage& b, const Points& from,
                                Points& to, int levels) {
  std::vector<uchar> status;
  std::vector<float> error;
  const cv::TermCriteria criteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 0.01);
  cv::calcOpticalFlowPyrLK(a.pyramid, b.pyramid, from, to, status, error,
                           cv::Size(kFlowWindow, kFlowWindow), levels, criteria,
                           cv::OPTFLOW_USE_INITIAL_FLOW);
  return status;
}

bool inside(const cv::Point2f& p, const cv::Mat& image) {
  return p.x >= 0.0F && p.y >= 0.0F && p.x <= static_cast<float>(image.cols - 1) &&
         p.y <= static_cast<float>(image.rows - 1);
}

Flow forward_backward_flow(const FrameImage& before, const FrameImage& now, const Points& from,
                           const Points& guess, int levels, double max_forward_backward_px) {
  Flow flow{guess, {}};
  const std::vector<uchar> forth = lucas_kanade(before, now, from, flow.to, levels);
  Points home = from;
  const std::vector<uchar> back = lucas_kanade(now, before, flow.to, home, 0);
  for (std::size_t i = 0; i < from.size(); ++i) {
    const bool returned = cv::norm(home[i] - from[i]) <= max_forward_backward_px;
    flow.found.push_back(forth[i] && back[i] && returned && inside(flow.to[i], now.gray) ? 1 : 0);
  }
  return flow;
}

}  // namespace

Flow compute_flow(const FrameImage& before, const FrameImage& now, const Points& from,
                  const Points& guess, const Points& second_guess, double max_forward_backward_px) {
  if (from.empty()) return {};
  Flow flow = forward_backward_flow(before, now, from, guess, kFineLevels, max_forward_backward_px);
  std::vector<std::size_t> failed;
  Points again_from;
  Points again_guess;
  for (std::size_t i = 0; i < from.size(); ++i) {
    if (flow.found[i] || !inside(second_guess[i], now.gray)) continue;
    failed.push_back(i);
    again_from.push_back(from[i]);
    again_guess.push_back(second_guess[i]);
  }
  if (failed.empty()) return flow;
  const Flow again = forward_backward_flow(before, now, again_from, again_guess,
                                           flow_levels(now.gray.size()), max_forward_backward_px);
  for (std::size_t k = 0; k < failed.size(); ++k) {
    flow.to[failed[k]] = again.to[k];
    flow.found[failed[k]] = again.found[k];
  }
  return flow;
}

}  // namespace apvi::vio
