// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <vector>

#include "survey/color_rule.hpp"
#include "survey/ground_products.hpp"
#include "survey/survey_map.hpp"
#include "survey/survey_view.hpp"

/// Meshes. Every function of this header throws InputError in a build without Open3D.
namespace apvi::survey {

struct Mesh {
  torch::Tensor vertices;   ///< [n,3] float64, in the coordinates of the map [m]
  torch::Tensor colors;     ///< [n,3] float64 in [0, 1]
  torch::Tensor triangles;  ///< [m,3] int32, counterclockwise from outside
};

/// Fuses depth (`reliable_depth`) and color of the map in `views` into a truncated signed distance
/// function (Curless and Levoy, 1996; Open3D's ScalableTSDFVolume) with voxels of `voxel_m` and a
/// truncation at four of them, and takes its zero surface by marching cubes, without what fewer
/// than three views show (`supported_points`). Where no view shows a surface there is a hole.
Mesh fuse(const mapping::Map& map, const std::vector<SurveyView>& views, const ColorRule& colors,
          double voxel_m, const Progress& progress);

/// Writes a mesh with normals and colors, moved by `T_file_map`: binary PLY with z up, or, by the
/// ending .glb, binary glTF, which has y up by definition. Throws RunError.
void write_mesh(const std::filesystem::path& file, const Mesh& mesh, const SE3& T_file_map);

}  // namespace apvi::survey
