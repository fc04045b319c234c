// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "mapping/rendering.hpp"
#include "viewer/scene.hpp"

namespace apvi::runs {

/// The Gaussians whose centers are in a section; all else is that of the map.
mapping::Map cut(const mapping::Map& map, const viewer::Section& section);

/// The last section of a map, kept while the camera moves around it.
class MapSection {
 public:
  /// The map itself without a section. Valid until the next call.
  const mapping::Map& of(const mapping::Map& map, const std::optional<viewer::Section>& section);
  /// Before another map.
  void clear() { section_.reset(); }

 private:
  std::optional<viewer::Section> section_;
  mapping::Map cut_;
};

}  // namespace apvi::runs
