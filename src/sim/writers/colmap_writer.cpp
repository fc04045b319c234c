// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <iterator>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/sensors/lens.hpp"
#include "sim/writers/dataset_writer.hpp"
#include "sim/writers/formats.hpp"

// COLMAP's text model: world-to-camera poses, quaternion wxyz. COLMAP's center of the first pixel
// is (0.5, 0.5), half a pixel off from this project's convention.
namespace apvi::sim {
namespace {

std::string camera_line(std::size_t id, const CameraModel::Parameters& p) {
  const std::string size = fmt::format("{} {}", p.width, p.height);
  const std::string pinhole =
      fmt::format("{:.9g} {:.9g} {:.9g} {:.9g}", p.fx, p.fy, p.cx + 0.5, p.cy + 0.5);
  const std::vector<double> k = coefficients_of(p);
  const std::string lens = fmt::format("{:.9g}", fmt::join(k, " "));
  switch (p.distortion) {
    case Distortion::none:
      return fmt::format("{} PINHOLE {} {}\n", id, size, pinhole);
    case Distortion::radtan:
      if (k.size() == 4) return fmt::format("{} OPENCV {} {} {}\n", id, size, pinhole, lens);
      return fmt::format("{} FULL_OPENCV {} {} {:.9g}\n", id, size, pinhole,
                         fmt::join(p.coefficients, " "));
    case Distortion::equidistant:
      return fmt::format("{} OPENCV_FISHEYE {} {} {}\n", id, size, pinhole, lens);
    case Distortion::double_sphere:
    case Distortion::eucm:
      break;
  }
  fail_input("rig: COLMAP has no camera model for {}; use another format", lens_name(p.distortion));
}

}  // namespace

void write_colmap(const std::filesystem::path& root, const Scene& scene,
                  const Recording& recording) {
  std::string cameras = "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n";
  std::string images = "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME, then POINTS2D[]\n";
  std::size_t id = 0;
  for (std::size_t c = 0; c < scene.rig.cameras.size(); ++c) {
    const CameraCalibration& camera = scene.rig.cameras[c];
    cameras += camera_line(c + 1, camera.model.parameters());
    for (const FrameTime& frame : recording.frames) {
      const SE3 T_world_body = recording.spline.at(frame.truth).T_world_body;
      const SE3 T_camera_world = (T_world_body * camera.T_body_camera).inverse();
      const auto& q = T_camera_world.rotation;
      const auto& t = T_camera_world.translation;
      fmt::format_to(std::back_inserter(images),
                     "{} {:.12f} {:.12f} {:.12f} {:.12f} {:.9f} {:.9f} {:.9f} {} cam{}/{}{}\n\n",
                     ++id, q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z(), c + 1, c,
                     frame.stamp.ns, image_extension(scene.config));
    }
  }
  const std::filesystem::path model = root / "sparse" / "0";
  write_file(model / "cameras.txt", cameras);
  write_file(model / "images.txt", images);
  write_file(model / "points3D.txt", "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n");
  write_file(root / "rig.yaml", config::to_yaml(perturbed_rig(scene)) + "\n");
}

}  // namespace apvi::sim
