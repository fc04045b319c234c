// SPDX-License-Identifier: BSD-3-Clause
// What a map bears: a full disk, a long run, water that is known better.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <torch/torch.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>

#include "apvi/core/error.hpp"
#include "apvi/mapping/mapper.hpp"
#include "apvi/splat/device.hpp"
#include "apvi/splat/morton.hpp"
#include "apvi/splat/ply.hpp"
#include "mapper_scene.hpp"
#include "support/posed_scene.hpp"
#include "support/tmp_dir.hpp"
#include "support/torch_reference.hpp"

namespace apvi::mapping {
namespace {

using test::camera_at;
using test::same;
using test::wall_of_gaussians;
using torch::Tensor;

void learn_from(Mapper& mapper, const splat::Gaussians& world, int number) {
  MapperInput input;
  input.keyframe = test::photograph(world, camera_at(0.1 * number, 0.0), number);
  input.points = points_of(world, 1000 * std::int64_t{number});
  mapper.add(input);
  for (int k = 0; k < 5; ++k) mapper.step();
}

/// Files of this process end after so many bytes, as on a full disk, while this lives.
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

TEST(MapperLimits, AMapThatHasSeenManyStepsMovesLess) {
  const splat::Gaussians world = wall_of_gaussians();
  const auto moves = [&world](double late_rates) {
    MapperOptions options = small_map_options();
    options.online.late_rates = late_rates;
    options.online.late_rates_steps = 5;
    Mapper mapper(options);
    for (int number = 0; number < 6; ++number) learn_from(mapper, world, number);
    const Tensor before = mapper.snapshot().gaussians.sh_dc;
    for (int k = 0; k < 10; ++k) mapper.step();
    return (mapper.snapshot().gaussians.sh_dc - before).abs().mean().item<double>();
  };
  EXPECT_LT(moves(0.1), 0.3 * moves(1.0));
}

TEST(MapperLimits, APictureSoonBeforeOrAfterAMurkyOneIsVeiled) {
  const splat::Gaussians world = wall_of_gaussians();
  Mapper mapper(small_map_options());
  const auto after = [&](double seconds, bool murky, bool held_out) {
    MapperInput input;
    input.keyframe = test::photograph(world, camera_at(0.01 * seconds, 0.0), 0, held_out);
    input.keyframe.stamp_ns = static_cast<std::int64_t>(1e9 * seconds) + 1;
    if (!held_out) input.points = points_of(world);
    input.murky = murky;
    return mapper.add(input);
  };
  EXPECT_EQ(after(1.0, false, false), Intake::taken);
  EXPECT_EQ(after(2.0, false, false), Intake::taken);
  EXPECT_EQ(after(2.5, false, true), Intake::held_out);
  EXPECT_EQ(after(2.7, false, false), Intake::taken);
  EXPECT_EQ(after(2.9, true, false), Intake::murky);
  // So were those just before it.
  EXPECT_EQ(mapper.keyframes().training(), (std::vector<std::size_t>{0, 1}));
  EXPECT_TRUE(mapper.keyframes().held_out().empty());
  EXPECT_EQ(after(3.2, false, false), Intake::murky);
  EXPECT_EQ(after(3.5, false, true), Intake::murky);
  EXPECT_EQ(after(3.7, false, false), Intake::taken);
  EXPECT_EQ(mapper.counts().at(Intake::murky), 5U);
  EXPECT_EQ(mapper.counts().at(Intake::taken), 3U);
  for (int i = 0; i < 20; ++i) mapper.step();
}

TEST(MapperLimits, ADiskThatIsFullLeavesTheLastMapAndSaysSo) {
  const splat::Gaussians world = wall_of_gaussians();
  const test::TmpDir dir;
  const auto checkpoint = dir.path() / "checkpoint.pt";
  const auto ply = dir.path() / "map.ply";
  Mapper mapper(small_map_options());
  learn_from(mapper, world, 0);
  mapper.save(checkpoint);
  splat::write_ply(ply, mapper.snapshot().gaussians, std::nullopt);
  const splat::Gaussians saved = mapper.snapshot().gaussians;
  learn_from(mapper, world, 1);
  {
    const FullDisk full(4096);
    EXPECT_THROW(mapper.save(checkpoint), RunError);
    EXPECT_THROW(splat::write_ply(ply, mapper.snapshot().gaussians, std::nullopt), RunError);
  }
  const auto files = std::distance(std::filesystem::directory_iterator(dir.path()), {});
  EXPECT_EQ(files, 2) << "half a file was left";
  Mapper resumed(small_map_options());
  resumed.resume(checkpoint);
  EXPECT_TRUE(same(resumed.snapshot().gaussians, saved));
  EXPECT_TRUE(torch::equal(splat::read_ply(ply).means, saved.means.cpu()));
  mapper.save(checkpoint);  // there is room again
  resumed.resume(checkpoint);
  EXPECT_TRUE(same(resumed.snapshot().gaussians, mapper.snapshot().gaussians));
}

double resident_mib() {
  std::ifstream file("/proc/self/statm");
  double pages = 0.0;
  file >> pages >> pages;
  return pages * static_cast<double>(sysconf(_SC_PAGESIZE)) / (1024.0 * 1024.0);
}

TEST(MapperLimits, MemoryStaysFlatOverThousandsOfKeyframes) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a sanitizer keeps what is freed";
#endif
  if (splat::active_device().is_cuda()) {
    GTEST_SKIP() << "a GPU's driver takes memory as it likes: benchmarks/map_soak looks there";
  }
  constexpr int kKeyframes = 3000;
  constexpr double kPictureMib = 96.0 * 128.0 * 3.0 / (1024.0 * 1024.0);
  MapperOptions options = small_map_options();
  options.trainer.densify.kind = Densification::gradient;
  options.trainer.densify.max_gaussians = 400;
  options.online.memory_mib = 30.0 * kPictureMib;
  options.online.heldout_views = 10;
  options.trainer.coarsest = 4;
  options.online.pyramid_uses = 1000000;
  Mapper mapper(options);
  const splat::Gaussians world = wall_of_gaussians(60);
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
  const double pictures = after_warming * kPictureMib;
  ASSERT_GT(pictures, 60.0);
  EXPECT_LT(resident_mib() - warm, 0.2 * pictures);
  EXPECT_LE(mapper.size(), 400);
}

TEST(MapLearner, LearnsOnFromAnotherOrderAsItWouldHave) {
  const KeyframeStore keyframes = test::photographs(test::wall_of_gaussians());
  splat::Gaussians world = test::wall_of_gaussians();
  torch::manual_seed(4);
  world.means = world.means + 0.02 * torch::randn_like(world.means);
  MapLearner moved(world, {}, keyframes.size());
  MapLearner whole(world, {}, keyframes.size());
  const StepSettings settings = {.sh_degree = 0, .rates = rates_at({}, 1.0, 0.0)};
  for (const std::size_t view : {std::size_t{1}, std::size_t{2}}) {
    moved.step(keyframes, view, settings);
    whole.step(keyframes, view, settings);
  }
  moved.reorder();
  const Tensor order = splat::morton_order(whole.map().means);
  ASSERT_FALSE(torch::equal(order.cpu(), torch::arange(order.size(0))));
  EXPECT_TRUE(torch::equal(moved.map().means, whole.map().means.index_select(0, order)));
  for (MapLearner* learner : {&moved, &whole}) learner->step(keyframes, 3, settings);
  EXPECT_TRUE(
      test::tensors_near(moved.map().means, whole.map().means.index_select(0, order), 1e-5));
}

TEST(MapLearner, PutsNeighboursTogetherNowAndThenAndResumesThere) {
  const KeyframeStore keyframes = test::photographs(test::wall_of_gaussians());
  TrainerOptions options;
  MapLearner learner(test::wall_of_gaussians(), options, keyframes.size());
  const StepSettings settings = {.sh_degree = 0, .rates = rates_at({}, 1.0, 0.0)};
  learner.step(keyframes, 1, settings);
  torch::serialize::OutputArchive out;
  learner.save(out);
  std::stringstream stream;
  out.save_to(stream);
  torch::serialize::InputArchive in;
  in.load_from(stream);
  MapLearner again(test::wall_of_gaussians(), options, keyframes.size());
  again.load(in);
  for (MapLearner* one : {&learner, &again}) {
    one->densify(1.0, one->size(), 0, 1000);  // as many as pass from one order to the next
    const Tensor order = splat::morton_order(one->map().means);
    EXPECT_TRUE(torch::equal(order.cpu(), torch::arange(one->size())));
    one->step(keyframes, 2, settings);
  }
  EXPECT_TRUE(torch::equal(learner.map().means, again.map().means));
}

TEST(MapLearner, NewWaterLeavesThePicturesAsTheyWere) {
  const splat::Gaussians flat = wall_of_gaussians(1500);
  splat::Gaussians world = flat;
  world.sh_rest = 0.1 * torch::randn({flat.size(), 3, 3});
  const KeyframeStore keyframes = test::photographs(flat);
  TrainerOptions options;
  options.sh_degree = 1;
  MapLearner learner(world, options, keyframes.size());
  const auto water = [](double beta, double b_inf) {
    return splat::Medium{.beta_d = torch::tensor({beta, 0.6 * beta, 0.7 * beta}),
                         .beta_b = torch::tensor({0.9 * beta, 0.5 * beta, 0.6 * beta}),
                         .b_inf = torch::tensor({0.2 * b_inf, b_inf, b_inf})};
  };
  const auto picture = [&] { return take_picture(learner.whole_map(), keyframes.view(0, 1)); };
  const Tensor none = torch::zeros({3, 3, 3}, torch::kFloat64);
  learner.adopt(water(0.1, 0.1), none, keyframes);
  const Picture before = picture();
  learner.adopt(water(0.3, 0.2), none, keyframes);
  const Picture after = picture();
  const Tensor solid = before.alpha > 0.98;
  ASSERT_GT(solid.to(torch::kFloat32).mean().item<double>(), 0.5);
  const Tensor change = (after.as_seen - before.as_seen).abs().mean(2);
  EXPECT_LT(change.masked_select(solid).mean().item<double>(), 0.005);
  EXPECT_GT((after.restored - before.restored).abs().mean().item<double>(), 0.1);
}

}  // namespace
}  // namespace apvi::mapping
