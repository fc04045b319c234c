// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/slam/mapper.hpp"

#include "slam/map_access.hpp"
#include "slam/mapper_options.hpp"

namespace apvi::slam {
namespace {

const Rig& with_camera(const Rig& rig) {
  if (rig.cameras.empty()) fail_input("the rig has no camera, which mapping requires");
  return rig;
}

}  // namespace

struct Mapper::Implementation {
  Implementation(const Options& options, const Rig& rig)
      : time_offset(Duration::from_seconds(with_camera(rig).cameras.front().time_offset_s)),
        mapper(async_mapper_options(options, rig), rig, {}) {}

  void check() const {
    if (mapper.failed()) fail_run("{}", error_of(mapper));
  }

  Duration time_offset;
  AsyncMapper mapper;
};

Mapper::Mapper(const Options& options, const Rig& rig) {
  options.check();
  translate_errors([&] { implementation_ = std::make_unique<Implementation>(options, rig); });
}

Mapper::~Mapper() = default;

void Mapper::add(const ImageFrame& image, const SE3& T_world_body) {
  localization::MapFrame frame;
  frame.image_stamp = image.stamp;
  frame.stamp = image.stamp - implementation_->time_offset;
  frame.T_world_body = T_world_body;
  translate_errors([&] { frame.image = image.decode(); });
  frame.mask = image.mask;
  if (frame.image.empty()) fail_input("image {}: cannot be decoded", image.stamp.ns);
  implementation_->mapper.push(std::move(frame));
  implementation_->check();
}

void Mapper::finish() {
  implementation_->mapper.finish();
  implementation_->check();
}

void Mapper::refine() {
  if (implementation_->mapper.gaussian_count() == 0) return;
  translate_errors([this] { implementation_->mapper.refine(); });
  implementation_->check();
}

void Mapper::stop() {
  implementation_->mapper.stop();
}

std::optional<MapSnapshot> Mapper::map() const {
  return snapshot_of(implementation_->mapper);
}

std::optional<RenderedImages> Mapper::render(const RenderView& view) const {
  return render_of(implementation_->mapper, view);
}

}  // namespace apvi::slam
