// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <utility>
#include <vector>

#include "core/text.hpp"
#include "io/folder/csv_sensors.hpp"
#include "io/folder/image_decode.hpp"
#include "io/readers.hpp"

// Raw folders of the underwater tank data set (SenseRoboticsLab, underwater_data_tools,
// bag2raw.py): images named by their stamp, and CSV files with specific column names.
namespace apvi::io {
namespace {

namespace fs = std::filesystem;

// The images of a folder in chronological order; their names are their stamps.
class ImageFolder : public SampleSource {
 public:
  ImageFolder(fs::path folder, int camera) : folder_(std::move(folder)), camera_(camera) {
    for (const auto& entry : fs::directory_iterator(folder_)) {
      const std::string extension = text::to_lower(entry.path().extension().string());
      if (extension != ".png" && extension != ".jpg" && extension != ".jpeg") continue;
      const auto ns = text::parse_int64(entry.path().stem().string());
      images_.emplace_back(ns.value_or(-1), entry.path().filename().string());
    }
    std::sort(images_.begin(), images_.end());
  }

  SourceState next(SensorEvent& event) override {
    if (next_ == images_.size()) return SourceState::end;
    const auto& [ns, name] = images_[next_++];
    if (ns < 0 || ns > kMaxStampNs) return SourceState::malformed;
    event = ImageFrame{Stamp{ns}, camera_, [path = folder_ / name, depth = depth_] {
                         return decode_image_file(path, *depth);
                       }};
    return SourceState::sample;
  }
  std::string where() const override { return (folder_ / images_[next_ - 1].second).string(); }
  double fraction() const override {
    return images_.empty() ? 1.0 : static_cast<double>(next_) / static_cast<double>(images_.size());
  }

 private:
  fs::path folder_;
  int camera_;
  SharedBitDepth depth_ = std::make_shared<BitDepth>();
  std::vector<std::pair<std::int64_t, std::string>> images_;
  std::size_t next_ = 0;
};

}  // namespace

Recording open_tank(const fs::path& root, const DatasetConfig& config, const SensorChoice& choice) {
  Recording recording;
  recording.rig = load_rig(config, root / "rig.yaml");
  const auto images = [](int camera) {
    return [camera](const fs::path& path) { return std::make_unique<ImageFolder>(path, camera); };
  };
  add_sensors(
      {{"imu0", "imu", "imu", root / "imu.csv", [](auto& p) { return csv_imu(CsvFile(p)); }},
       {"dvl0", "dvl", "dvl", root / "dvl.csv", [](auto& p) { return csv_dvl(CsvFile(p)); }},
       {"depth0", "depth", "pressure", root / "depth.csv",
        [](auto& p) { return csv_depth(CsvFile(p)); }},
       {"cam0", "camera", "camera", root / "IMG_L", images(0)},
       {"cam1", "camera", "camera", root / "IMG_R", images(1)}},
      choice, recording);
  recording.reference = [truth = root / "gt.csv"] {
    return fs::exists(truth) ? read_reference(truth) : std::nullopt;
  };
  return recording;
}

}  // namespace apvi::io
