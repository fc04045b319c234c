// SPDX-License-Identifier: BSD-3-Clause
// Maps larger than memory.
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "mapping/long_wall.hpp"
#include "mapping/mapper.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::mapping {
namespace {

namespace fs = std::filesystem;
using test::bitwise_equal;

constexpr double kSmallMemory_mib = 0.06;  // a few parts, and seven images

MapperOptions options_with_folder(const fs::path& folder, double memory_mib = kSmallMemory_mib) {
  MapperOptions options = options_with(memory_mib);
  options.storage_folder = folder;
  return options;
}

std::size_t files_in(const fs::path& folder) {
  if (!fs::exists(folder)) return 0;
  return static_cast<std::size_t>(
      std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
}

/// Back to the beginning of the wall.
void return_to_start(Mapper& mapper, const gaussians::Gaussians& world) {
  std::int64_t number = 1000;
  for (double x = kLength_m - 4.0; x >= 0.0; x -= 4.0) visit(mapper, world, x, number++, 4);
}

TEST(StorageFolder, FilesGiveTheSameMapAsMemory) {
  const test::TmpDir tmp;
  const gaussians::Gaussians world = long_wall();
  Mapper on_disk = along_the_wall(world, options_with_folder(tmp.path() / "storage"));
  Mapper in_memory = along_the_wall(world, options_with(100.0));
  EXPECT_GT(files_in(tmp.path() / "storage"), 20U);
  EXPECT_GT(on_disk.keyframes().images_on_disk(), 10U);
  EXPECT_EQ(on_disk.keyframes().training(), in_memory.keyframes().training());
  EXPECT_TRUE(bitwise_equal(on_disk.snapshot().gaussians, in_memory.snapshot().gaussians));
  for (Mapper* mapper : {&on_disk, &in_memory}) {
    return_to_start(*mapper, world);
    mapper->begin_final();
    for (int k = 0; k < 60; ++k) mapper->step();
  }
  EXPECT_TRUE(bitwise_equal(on_disk.snapshot().gaussians, in_memory.snapshot().gaussians));
}

TEST(StorageFolder, MemoryStaysWithinItsLimit) {
  const test::TmpDir tmp;
  const gaussians::Gaussians world = long_wall();
  const Mapper mapper = along_the_wall(world, options_with_folder(tmp.path() / "storage"));
  const double limit = 0.5 * kSmallMemory_mib * 1024.0 * 1024.0;
  EXPECT_LE(static_cast<double>(mapper.keyframes().host_image_bytes()), limit);
  EXPECT_EQ(mapper.preview().gaussians.size() < mapper.size(), true);
}

TEST(StorageFolder, WithoutACheckpointNothingIsLeftBehind) {
  const test::TmpDir tmp;
  const gaussians::Gaussians world = long_wall();
  {
    const Mapper mapper = along_the_wall(world, options_with_folder(tmp.path() / "storage"));
    EXPECT_TRUE(fs::exists(tmp.path() / "storage"));
  }
  EXPECT_FALSE(fs::exists(tmp.path() / "storage"));
}

TEST(StorageFolder, ACheckpointKeepsItsFiles) {
  const test::TmpDir tmp;
  const gaussians::Gaussians world = long_wall();
  const MapperOptions options = options_with_folder(tmp.path() / "storage");
  gaussians::Gaussians saved;
  {
    Mapper mapper = along_the_wall(world, options);
    mapper.save(tmp.path() / "checkpoint");
    saved = mapper.snapshot().gaussians;
    return_to_start(mapper, world);  // later changes do not reach the checkpoint
  }
  std::ofstream(tmp.path() / "storage" / "999.pt") << "of a run that was killed";
  Mapper resumed(options);
  resumed.resume(tmp.path() / "checkpoint");
  EXPECT_FALSE(fs::exists(tmp.path() / "storage" / "999.pt"));
  EXPECT_GT(resumed.keyframes().images_on_disk(), 10U);
  EXPECT_TRUE(bitwise_equal(resumed.snapshot().gaussians, saved));
}

TEST(StorageFolder, ANewerCheckpointReplacesTheFilesOfTheOlderOne) {
  const test::TmpDir tmp;
  const gaussians::Gaussians world = long_wall();
  const MapperOptions options = options_with_folder(tmp.path() / "storage");
  {
    Mapper mapper = along_the_wall(world, options);
    mapper.save(tmp.path() / "checkpoint");
    return_to_start(mapper, world);
    mapper.save(tmp.path() / "checkpoint");
  }
  const std::size_t files = files_in(tmp.path() / "storage");
  Mapper resumed(options);
  resumed.resume(tmp.path() / "checkpoint");
  EXPECT_EQ(files_in(tmp.path() / "storage"), files);
}

TEST(StorageFolder, AFullDiskIsReportedAndTheMapGoesOn) {
  const test::TmpDir tmp;
  const fs::path file = tmp.write("file", "");
  const gaussians::Gaussians world = long_wall();
  testing::internal::CaptureStderr();
  const Mapper mapper = along_the_wall(world, options_with_folder(file / "storage"));
  const std::string log = testing::internal::GetCapturedStderr();
  EXPECT_NE(log.find("cannot be written"), std::string::npos) << log;
  EXPECT_NE(log.find("limited by memory from now on"), std::string::npos) << log;
  EXPECT_GT(own_means(mapper, 47).size(0), 0);
  EXPECT_LE(mapper.optimizer().size(), kLimit);
}

TEST(StorageFolder, DiskSpaceHasALimit) {
  const test::TmpDir tmp;
  const gaussians::Gaussians world = long_wall();
  MapperOptions options = options_with_folder(tmp.path() / "storage");
  options.online.stored_disk_mib = 0.1;
  const Mapper mapper = along_the_wall(world, options);
  std::uintmax_t bytes = 0;
  for (const auto& entry : fs::directory_iterator(tmp.path() / "storage")) {
    bytes += entry.file_size();
  }
  EXPECT_GT(bytes, 50'000U);
  EXPECT_LT(bytes, 400'000U);  // small files are half header
}

TEST(StorageFolder, ALostFileCostsOnlyItsPart) {
  const test::TmpDir tmp;
  const fs::path folder = tmp.path() / "storage";
  const gaussians::Gaussians world = long_wall();
  Mapper mapper = along_the_wall(world, options_with_folder(folder));
  const std::int64_t before = mapper.size();
  for (const auto& entry : fs::directory_iterator(folder)) {
    std::ofstream(entry.path(), std::ios::trunc) << "damaged";
  }
  testing::internal::CaptureStderr();
  EXPECT_LT(mapper.snapshot().gaussians.size(), before);
  return_to_start(mapper, world);
  const std::string log = testing::internal::GetCapturedStderr();
  EXPECT_NE(log.find("this part of the map is lost"), std::string::npos) << log;
  EXPECT_GT(own_means(mapper, 47).size(0) + mapper.stored(), 0);
}

}  // namespace
}  // namespace apvi::mapping
