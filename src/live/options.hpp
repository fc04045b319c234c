// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "apvi/config/fields.hpp"

namespace apvi::live {

/// How images are recorded, both without loss: png is a third smaller, pnm takes no time to encode.
enum class ImageFormat { png, pnm };

/// The `live` section of a run's configuration.
struct Options {
  std::vector<std::string> sources;
  std::vector<std::string> outputs;
  double output_rate_hz = 0.0;
  bool record = true;
  ImageFormat image_format = ImageFormat::png;
  double max_wait_s = 0.5;
  double duration_s = 0.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("sources", sources,
      "addresses of vehicles, sensors and cameras, as arguments of `apvi live`");
    v("outputs", outputs, "where poses go: tum:PATH, udp://HOST:PORT, mavlink://udp:HOST:PORT");
    v("output_rate_hz", output_rate_hz, Range{0.0, 1000.0},
      "highest rate of poses to an output; 0: every pose [Hz]");
    v("record", record, "record what is received into the run folder");
    v("image_format", image_format,
      config::Choices<ImageFormat>{{"png", ImageFormat::png}, {"pnm", ImageFormat::pnm}},
      "recorded images, without loss in both cases: png, or pnm, which is larger and faster");
    v("max_wait_s", max_wait_s, Range{0.0, 10.0},
      "longest time that a sample is held back for older ones of other sensors [s]");
    v("duration_s", duration_s, Range{0.0, 1e9}, "length of the run; 0: until Ctrl-C [s]");
  }
};

}  // namespace apvi::live
