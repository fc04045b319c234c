// SPDX-License-Identifier: BSD-3-Clause
// Mapper limits: full disk, long runs, learning rate decay, visibility; and MapOptimizer.
#include <gtest/gtest.h>
#include <malloc.h>
#include <sys/resource.h>
#include <torch/torch.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <sstream>

#include "apvi/core/error.hpp"
#include "gaussians/device.hpp"
#include "gaussians/model/morton.hpp"
#include "map_io/ply.hpp"
#include "mapping/mapper.hpp"
#include "mapping/mapper_scene.hpp"
#include "support/posed_scene.hpp"
#include "support/tmp_dir.hpp"
#include "support/torch_reference.hpp"

namespace apvi::mapping {
namespace {

using test::bitwise_equal;
using test::camera_at;
using test::gaussian_wall;
using torch::Tensor;

void add_and_train(Mapper& mapper, const gaussians::Gaussians& world, int number) {
  MapperInput input;
  input.keyframe = test::render_keyframe(world, camera_at(0.1 * number, 0.0), number);
  input.points = points_of(world, 1000 * std::int64_t{number});
  mapper.add(input);
  for (int k = 0; k < 5; ++k) mapper.step();
}

/// Limits the file size of this process during its lifetime, like a full disk.
class FullDisk {
 public:
  explicit FullDisk(rlim_t bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit limit = {.rlim_cur = bytes, .rlim_max = before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FullDisk() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;

 private:
  rlimit before_ = {};
  void (*handler_)(int);
};

TEST(MapperLimits, LearningRatesDecayDuringMapping) {
  const gaussians::Gaussians world = gaussian_wall();
  const auto moves = [&world](double final_rate_factor) {
    MapperOptions options = small_map_options();
    options.online.final_rate_factor = final_rate_factor;
    options.online.rate_decay_steps = 5;
    Mapper mapper(options);
    for (int number = 0; number < 6; ++number) add_and_train(mapper, world, number);
    const Tensor before = mapper.snapshot().gaussians.sh_dc;
    for (int k = 0; k < 10; ++k) mapper.step();
    return (mapper.snapshot().gaussians.sh_dc - before).abs().mean().item<double>();
  };
  EXPECT_LT(moves(0.1), 0.3 * moves(1.0));
}

TEST(MapperLimits, SparseAdamIsThatOfTheMapOrElseThatOfIncrementalMapping) {
  const gaussians::Gaussians world = gaussian_wall();
  const auto map_with = [&world](std::optional<bool> sparse, bool online_sparse) {
    MapperOptions options = small_map_options();
    options.trainer.sparse_adam = sparse;
    options.online.sparse_adam = online_sparse;
    Mapper mapper(options);
    for (int number = 0; number < 6; ++number) add_and_train(mapper, world, number);
    return mapper.snapshot().gaussians;
  };
  const gaussians::Gaussians sparse = map_with(std::nullopt, true);
  const gaussians::Gaussians dense = map_with(std::nullopt, false);
  EXPECT_FALSE(test::bitwise_equal(sparse, dense));
  EXPECT_TRUE(test::bitwise_equal(map_with(false, true), dense));
  EXPECT_TRUE(test::bitwise_equal(map_with(true, false), sparse));
}

TEST(MapperLimits, RejectsImagesAroundLowVisibility) {
  const gaussians::Gaussians world = gaussian_wall();
  Mapper mapper(small_map_options());
  const auto after = [&](double seconds, bool low_visibility, bool held_out) {
    MapperInput input;
    input.keyframe = test::render_keyframe(world, camera_at(0.01 * seconds, 0.0), 0, held_out);
    input.keyframe.stamp_ns = static_cast<std::int64_t>(1e9 * seconds) + 1;
    if (!held_out) input.points = points_of(world);
    input.low_visibility = low_visibility;
    return mapper.add(input);
  };
  EXPECT_EQ(after(1.0, false, false), KeyframeDecision::accepted);
  EXPECT_EQ(after(2.0, false, false), KeyframeDecision::accepted);
  EXPECT_EQ(after(2.5, false, true), KeyframeDecision::held_out);
  EXPECT_EQ(after(2.7, false, false), KeyframeDecision::accepted);
  EXPECT_EQ(after(2.9, true, false), KeyframeDecision::low_visibility);
  // Images just before are dropped as well.
  EXPECT_EQ(mapper.keyframes().training(), (std::vector<std::size_t>{0, 1}));
  EXPECT_TRUE(mapper.keyframes().held_out().empty());
  EXPECT_EQ(after(3.2, false, false), KeyframeDecision::low_visibility);
  EXPECT_EQ(after(3.5, false, true), KeyframeDecision::low_visibility);
  EXPECT_EQ(after(3.7, false, false), KeyframeDecision::accepted);
  EXPECT_EQ(mapper.counts().at(KeyframeDecision::low_visibility), 5U);
  EXPECT_EQ(mapper.counts().at(KeyframeDecision::accepted), 3U);
  for (int i = 0; i < 20; ++i) mapper.step();
}

TEST(MapperLimits, FullDiskKeepsThePreviousFiles) {
  const gaussians::Gaussians world = gaussian_wall();
  const test::TmpDir dir;
  const auto checkpoint = dir.path() / "checkpoint.pt";
  const auto ply = dir.path() / "map.ply";
  Mapper mapper(small_map_options());
  add_and_train(mapper, world, 0);
  mapper.save(checkpoint);
  map_io::write_ply(ply, mapper.snapshot().gaussians, std::nullopt);
  const gaussians::Gaussians saved = mapper.snapshot().gaussians;
  add_and_train(mapper, world, 1);
  {
    const FullDisk full(4096);
    EXPECT_THROW(mapper.save(checkpoint), RunError);
    EXPECT_THROW(map_io::write_ply(ply, mapper.snapshot().gaussians, std::nullopt), RunError);
  }
  const auto files = std::distance(std::filesystem::directory_iterator(dir.path()), {});
  EXPECT_EQ(files, 2) << "a partial file was left";
  Mapper resumed(small_map_options());
  resumed.resume(checkpoint);
  EXPECT_TRUE(bitwise_equal(resumed.snapshot().gaussians, saved));
  EXPECT_TRUE(torch::equal(map_io::read_ply(ply).means, saved.means.cpu()));
  mapper.save(checkpoint);  // the limit is gone
  resumed.resume(checkpoint);
  EXPECT_TRUE(bitwise_equal(resumed.snapshot().gaussians, mapper.snapshot().gaussians));
}

// Without what the allocator keeps for later, which depends on how threads were scheduled.
double resident_mib() {
  malloc_trim(0);
  std::ifstream file("/proc/self/statm");
  double pages = 0.0;
  file >> pages >> pages;
  return pages * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1024.0 * 1024.0);
}

TEST(MapperLimits, MemoryIsBoundedOverThousandsOfKeyframes) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a sanitizer keeps what is freed";
#endif
  if (gaussians::active_device().is_cuda()) {
    GTEST_SKIP() << "a GPU's driver takes memory as it likes: benchmarks/map_soak looks there";
  }
  constexpr int kKeyframes = 3000;
  constexpr double kImageMib = 96.0 * 128.0 * 3.0 / (1024.0 * 1024.0);
  MapperOptions options = small_map_options();
  options.trainer.densify.kind = Densification::gradient;
  options.trainer.densify.max_gaussians = 400;
  options.online.image_memory_mib = 30.0 * kImageMib;
  options.online.max_heldout_views = 10;
  options.trainer.initial_downscale = 4;
  options.online.uses_per_pyramid_level = 1000000;
  Mapper mapper(options);
  const gaussians::Gaussians world = gaussian_wall(60);
  torch::manual_seed(2);
  double warm = 0.0;
  for (int i = 0; i < kKeyframes; ++i) {
    MapperInput input;
    input.keyframe.stamp_ns = i;
    input.keyframe.held_out = i % 5 == 1;
    input.keyframe.number = i / 5;
    input.keyframe.intrinsics = {
        .fx = 100.0, .fy = 100.0, .cx = 64.0, .cy = 48.0, .width = 128, .height = 96};
    input.keyframe.T_camera_world = camera_at(0.001 * i - 1.5, 0.0);
    input.keyframe.image = torch::randint(0, 256, {96, 128, 3}, torch::kUInt8);
    if (!input.keyframe.held_out) input.points = points_of(world, 60 * std::int64_t{i});
    mapper.add(input);
    if (i % 10 == 0 && mapper.ready()) mapper.step();
    if (i == kKeyframes / 3) warm = resident_mib();
  }
  const int after_warming = kKeyframes - kKeyframes / 3;
  const double images = after_warming * kImageMib;
  ASSERT_GT(images, 60.0);
  EXPECT_LT(resident_mib() - warm, 0.2 * images);
  EXPECT_LE(mapper.size(), 400);
}

TEST(MapOptimizer, IsInvariantToReordering) {
  const KeyframeStore keyframes = test::render_keyframes(test::gaussian_wall());
  gaussians::Gaussians world = test::gaussian_wall();
  torch::manual_seed(4);
  world.means = world.means + 0.02 * torch::randn_like(world.means);
  MapOptimizer moved(world, {}, keyframes.size());
  MapOptimizer whole(world, {}, keyframes.size());
  const StepSettings settings = {.sh_degree = 0, .rates = rates_at({}, 1.0, 0.0)};
  for (const std::size_t view : {std::size_t{1}, std::size_t{2}}) {
    moved.step(keyframes, view, settings);
    whole.step(keyframes, view, settings);
  }
  moved.reorder();
  const Tensor order = gaussians::morton_order(whole.map().means);
  ASSERT_FALSE(torch::equal(order.cpu(), torch::arange(order.size(0))));
  EXPECT_TRUE(torch::equal(moved.map().means, whole.map().means.index_select(0, order)));
  for (MapOptimizer* optimizer : {&moved, &whole}) optimizer->step(keyframes, 3, settings);
  EXPECT_TRUE(
      test::tensors_near(moved.map().means, whole.map().means.index_select(0, order), 1e-5));
}

TEST(MapOptimizer, ReordersPeriodicallyAlsoAfterResuming) {
  const KeyframeStore keyframes = test::render_keyframes(test::gaussian_wall());
  TrainerOptions options;
  MapOptimizer optimizer(test::gaussian_wall(), options, keyframes.size());
  const StepSettings settings = {.sh_degree = 0, .rates = rates_at({}, 1.0, 0.0)};
  optimizer.step(keyframes, 1, settings);
  torch::serialize::OutputArchive out;
  optimizer.save(out);
  std::stringstream stream;
  out.save_to(stream);
  torch::serialize::InputArchive in;
  in.load_from(stream);
  MapOptimizer again(test::gaussian_wall(), options, keyframes.size());
  again.load(in);
  for (MapOptimizer* one : {&optimizer, &again}) {
    one->densify(1.0, one->size(), 0, 1000);  // one reorder interval
    const Tensor order = gaussians::morton_order(one->map().means);
    EXPECT_TRUE(torch::equal(order.cpu(), torch::arange(one->size())));
    one->step(keyframes, 2, settings);
  }
  EXPECT_TRUE(torch::equal(optimizer.map().means, again.map().means));
}

TEST(MapOptimizer, StartMediumKeepsTheRenderings) {
  const gaussians::Gaussians flat = gaussian_wall(1500);
  gaussians::Gaussians world = flat;
  world.sh_rest = 0.1 * torch::randn({flat.size(), 3, 3});
  const KeyframeStore keyframes = test::render_keyframes(flat);
  TrainerOptions options;
  options.sh_degree = 1;
  MapOptimizer optimizer(world, options, keyframes.size());
  const auto water = [](double beta, double b_inf) {
    return medium::Medium{.beta_d = torch::tensor({beta, 0.6 * beta, 0.7 * beta}),
                          .beta_b = torch::tensor({0.9 * beta, 0.5 * beta, 0.6 * beta}),
                          .b_inf = torch::tensor({0.2 * b_inf, b_inf, b_inf})};
  };
  const auto image = [&] { return render_map(optimizer.full_map(), keyframes.view(0, 1)); };
  optimizer.start_medium(water(0.1, 0.1), keyframes);
  const MapRendering before = image();
  optimizer.start_medium(water(0.3, 0.2), keyframes);
  const MapRendering after = image();
  const Tensor solid = before.alpha > 0.98;
  ASSERT_GT(solid.to(torch::kFloat32).mean().item<double>(), 0.5);
  const Tensor change = (after.color - before.color).abs().mean(2);
  EXPECT_LT(change.masked_select(solid).mean().item<double>(), 0.005);
  EXPECT_GT((after.restored - before.restored).abs().mean().item<double>(), 0.1);
}

}  // namespace
}  // namespace apvi::mapping
