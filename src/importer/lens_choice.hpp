// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "importer/lens_adjustment.hpp"

namespace apvi::importer {

struct LensChoice {
  FieldOfView view;      ///< the one to use, with `origin` as a reason
  std::string evidence;  ///< what the tracks say, for the log and rig.yaml
};

/// Chooses the lens of a camera that nobody calibrated by the reprojection error of bundle
/// adjustments. Candidates are rectilinear and equidistant lenses, under water with and without a
/// flat port, each with the focal length free and started at several angles of view. The best one
/// replaces `assumed`, whose focal length stays fixed in its own adjustment, if the logarithm of
/// the error is smaller in the segments by a paired t test (99.5 %). Otherwise the evidence is
/// ambiguous and `assumed` is kept. Segments must be independent: of different images.
LensChoice choose_lens(const FieldOfView& assumed, ImageSize size, bool under_water,
                       const std::vector<TrackSegment>& segments);

}  // namespace apvi::importer
