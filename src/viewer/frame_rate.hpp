// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <deque>

namespace apvi::viewer {

/// Chooses the size of the images of a moving view, so that they follow each other fast enough for
/// the slower of the renderer and the link.
class FrameRate {
 public:
  /// `target_s`: time between two images to aim for.
  explicit FrameRate(double target_s) : target_s_(target_s) {}

  /// Reports an image that a page has drawn. `render_s`: time to make it, times the number of
  /// watchers that share the renderer; `link_s`: from sending it to the answer that it is drawn.
  void add(double render_s, double link_s, std::size_t bytes);
  /// Width and height of images relative to the full size, a multiple of 1/8 from 1/4 to 1.
  double scale() const;

 private:
  struct Transfer {
    double bytes = 0.0;
    double link_s = 0.0;
  };
  double seconds_per_byte() const;

  double target_s_;
  double area_ = 1.0;  // wanted, relative to the full size
  std::deque<Transfer> transfers_;
};

}  // namespace apvi::viewer
