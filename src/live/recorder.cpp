// SPDX-License-Identifier: BSD-3-Clause
#include "live/recorder.hpp"

#include <opencv2/imgcodecs.hpp>
#include <type_traits>
#include <utility>
#include <variant>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "io/folder/csv_rows.hpp"

namespace apvi::live {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxWaiting = 65'536;  // samples; minutes of all sensors
constexpr std::size_t kMaxWaitingImages = 32;
constexpr std::chrono::seconds kFlushPeriod{1};

constexpr std::pair<const char*, std::string_view> kHeaders[] = {
    {"imu0", io::kImuCsvHeader},           {"dvl0", io::kDvlCsvHeader},
    {"pressure0", io::kPressureCsvHeader}, {"depth0", io::kDepthCsvHeader},
    {"cam0", io::kImageCsvHeader},         {"cam1", io::kImageCsvHeader}};

std::string sensor_of(const SensorEvent& event) {
  if (const auto* image = std::get_if<ImageFrame>(&event)) {
    return fmt::format("cam{}", image->camera);
  }
  return fmt::format("{}0", kind_of(event));
}

std::string extension_of(ImageFormat format, const cv::Mat& pixels) {
  if (format == ImageFormat::png) return ".png";
  return pixels.channels() == 1 ? ".pgm" : ".ppm";
}

std::ofstream open_to_write(const fs::path& path) {
  std::error_code error;
  fs::create_directories(path.parent_path(), error);
  std::ofstream out(path, std::ios::binary);
  if (!out) fail_run("{}: cannot be written", path.string());
  return out;
}

}  // namespace

Recorder::Recorder(fs::path folder, const config::Node& rig, ImageFormat images)
    : folder_(std::move(folder)),
      images_(images),
      worker_(kMaxWaiting, Overflow::drop_oldest, [this](const SensorEvent& e) { process(e); }) {
  for (const auto& [sensor, header] : kHeaders) {
    if (rig.find(sensor) != nullptr) open(sensor, header);
  }
  io::write_text_file(folder_ / "rig.yaml", config::to_yaml(rig) + "\n");
}

void Recorder::open(const std::string& sensor, std::string_view header) {
  const fs::path folder = folder_ / "mav0" / sensor;
  if (sensor.starts_with("cam")) fs::create_directories(folder / "data");
  std::ofstream& out = files_[sensor] = open_to_write(folder / "data.csv");
  out << header << '\n';
}

void Recorder::push(const SensorEvent& event) {
  if (failed_ || !files_.contains(sensor_of(event))) return;
  if (std::holds_alternative<ImageFrame>(event)) {
    if (waiting_images_ >= kMaxWaitingImages) {
      if (++dropped_images_ == 1) {
        log::warning("{}: disk or encoder are too slow; the recording leaves images out",
                     folder_.string());
      }
      return;
    }
    ++waiting_images_;
  }
  worker_.push(event);
}

void Recorder::finish() {
  worker_.wait();
  flush();
}

void Recorder::process(const SensorEvent& event) {
  if (std::holds_alternative<ImageFrame>(event)) --waiting_images_;
  if (failed_) return;
  try {
    write(event);
    if (std::chrono::steady_clock::now() - flushed_ >= kFlushPeriod) flush();
  } catch (const std::exception& e) {
    failed_ = true;
    log::error("the recording has stopped: {}", e.what());
  }
}

void Recorder::write(const SensorEvent& event) {
  const auto write_one = [&](const auto& sample) {
    using Sample = std::decay_t<decltype(sample)>;
    if constexpr (std::is_same_v<Sample, ImageFrame>) {
      write(sample);
    } else if constexpr (!std::is_same_v<Sample, GnssSample>) {
      add_row(sensor_of(event), io::csv_row(sample, io::kExactDigits));
    }
  };
  std::visit(write_one, event);
}

void Recorder::write(const ImageFrame& image) {
  constexpr int kFastest = 1;
  const std::string sensor = fmt::format("cam{}", image.camera);
  const cv::Mat pixels = image.decode();
  const std::string extension = extension_of(images_, pixels);
  const std::string name = fmt::format("{}{}", image.stamp.ns, extension);
  std::vector<unsigned char> bytes;
  cv::imencode(extension, pixels, bytes, {cv::IMWRITE_PNG_COMPRESSION, kFastest});
  std::ofstream out = open_to_write(folder_ / "mav0" / sensor / "data" / name);
  out.write(reinterpret_cast<const char*>(bytes.data()),
            static_cast<std::streamsize>(bytes.size()));
  out.close();
  if (!out) fail_run("{}: cannot write {} (disk full?)", folder_.string(), name);
  add_row(sensor, fmt::format("{},{}", image.stamp.ns, name));
}

void Recorder::add_row(const std::string& sensor, const std::string& row) {
  std::ofstream& out = files_.at(sensor);
  if (!(out << row << '\n')) fail_run("{}: cannot write {} (disk full?)", folder_.string(), sensor);
}

void Recorder::flush() {
  flushed_ = std::chrono::steady_clock::now();
  for (auto& [sensor, out] : files_) {
    if (!out.flush() && !failed_) {
      fail_run("{}: cannot write {} (disk full?)", folder_.string(), sensor);
    }
  }
}

}  // namespace apvi::live
