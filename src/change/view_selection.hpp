// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "change/session.hpp"

namespace apvi::change {

/// What the views of a session show.
struct Scale {
  double depth_m = 0.0;  ///< median depth of the surface; 0 when no view shows one
  double light = 0.0;    ///< median light of surfaces, without water and lamps
};
/// By up to 16 of the views, evenly spread.
Scale scale_of(const Session& session);

/// The session's views at the resolution at which a pixel at `depth_m` is `pixel_m` wide, or at
/// their own if that is lower. Views that differ from an earlier one by less than a tenth of the
/// depth and 10 degrees add nothing and are left out; of the rest, at most `most` are kept, evenly
/// spread.
std::vector<gaussians::View> thinned_views(const Session& session, double depth_m, double pixel_m,
                                           std::size_t most);

}  // namespace apvi::change
