// SPDX-License-Identifier: BSD-3-Clause
#include "importer/dive_writer.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <system_error>

#include "apvi/core/error.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/sensors/lens.hpp"

namespace apvi::importer {
namespace {

namespace fs = std::filesystem;

constexpr double kMaxTime_s = 1e7;  // a third of a year; longer times are damage
constexpr const char* kImages = "mav0/cam0";

void make_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) fail_run("{}: cannot create this folder: {}", folder.string(), error.message());
}

// Replaces only what an import has made: --overwrite must not delete a home folder.
void write_bytes(const fs::path& path, Bytes bytes) {
  std::ofstream out(path, std::ios::binary);
  out.write(reinterpret_cast<const char*>(bytes.data()),
            static_cast<std::streamsize>(bytes.size()));
  out.close();
  if (!out) fail_run("{}: cannot be written; is the disk full?", path.string());
}

void check_free(const fs::path& folder, bool overwrite) {
  if (!fs::exists(folder) || (fs::is_directory(folder) && fs::is_empty(folder))) return;
  if (!overwrite) {
    fail_input("{}: exists; choose another folder with -o, or use --overwrite", folder.string());
  }
  if (!fs::exists(folder / kImportNotes)) {
    fail_input("{}: not made by `apvi import`; choose another folder with -o", folder.string());
  }
}

template <typename T>
std::string cell(const std::optional<T>& value) {
  return value ? fmt::format("{:.9g}", *value) : "";
}

}  // namespace

std::optional<Stamp> Clock::at(double time_s) const {
  if (!(std::abs(time_s) < kMaxTime_s)) return std::nullopt;
  const Stamp stamp = zero + Duration::from_seconds(time_s);
  return stamp.ns < 0 ? std::nullopt : std::optional(stamp);
}

DiveWriter::DiveWriter(fs::path folder, bool overwrite) : folder_(std::move(folder)) {
  if (!folder_.has_filename()) folder_ = folder_.parent_path();  // "dive/"
  check_free(folder_, overwrite);
  partial_ = folder_;
  partial_ += ".partial";
  if (fs::exists(partial_) && !fs::exists(partial_ / kImages)) {
    fail_input("{}: is in the way; move it, or choose another folder with -o", partial_.string());
  }
  std::error_code ignored;
  fs::remove_all(partial_, ignored);  // of an import that was killed
  make_folder(partial_ / kImages / "data");
}

DiveWriter::~DiveWriter() {
  std::error_code ignored;
  if (!finished_) fs::remove_all(partial_, ignored);
}

void DiveWriter::add_image(Stamp stamp, const std::string& extension, Bytes encoded) {
  const std::string name = std::to_string(stamp.ns) + extension;
  const fs::path path = partial_ / kImages / "data" / name;
  write_bytes(path, encoded);
  images_csv_ += fmt::format("{},{}\n", stamp.ns, name);
  stamps_.push_back(stamp);
  image_files_.push_back(path);
}

void DiveWriter::add_mask(Bytes encoded) {
  const fs::path folder = partial_ / kImages / "masks";
  make_folder(folder);
  write_bytes(folder / (std::to_string(stamps_.back().ns) + ".png"), encoded);
}

double DiveWriter::image_rate_hz() const {
  if (stamps_.size() < 2) return 1.0;
  const double span = seconds_between(stamps_.front(), stamps_.back());
  return std::clamp(static_cast<double>(stamps_.size() - 1) / span, 0.01, 10000.0);
}

void DiveWriter::write_imu(const std::vector<ImuRow>& rows, const Clock& clock) {
  std::string csv =
      "#timestamp [ns],w_x [rad s^-1],w_y [rad s^-1],w_z [rad s^-1],a_x [m s^-2],a_y [m s^-2],"
      "a_z [m s^-2]\n";
  for (const ImuRow& row : rows) {
    const auto stamp = clock.at(row.time_s);
    if (!stamp) continue;
    const auto& w = row.gyro;
    const auto& a = row.accel;
    fmt::format_to(std::back_inserter(csv), "{},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g}\n",
                   stamp->ns, w.x(), w.y(), w.z(), a.x(), a.y(), a.z());
  }
  write_text("mav0/imu0/data.csv", csv);
}

void DiveWriter::write_exposure(const std::vector<ExposureRow>& rows, const Clock& clock) {
  std::string csv =
      "#timestamp [ns],shutter [s],iso,white_balance [K],gain_red,gain_green,gain_blue\n";
  for (const ExposureRow& row : rows) {
    const auto stamp = clock.at(row.time_s);
    if (!stamp) continue;
    std::string gains = ",,";
    if (row.gains)
      gains =
          fmt::format("{:.9g},{:.9g},{:.9g}", (*row.gains)[0], (*row.gains)[1], (*row.gains)[2]);
    fmt::format_to(std::back_inserter(csv), "{},{},{},{},{}\n", stamp->ns, cell(row.shutter_s),
                   cell(row.iso), cell(row.white_balance_k), gains);
  }
  write_text("mav0/exposure0/data.csv", csv);
}

void DiveWriter::write_poses(const Trajectory& poses) {
  const fs::path file = partial_ / "mav0/state_groundtruth_estimate0/data.csv";
  make_folder(file.parent_path());
  io::write_euroc(file, poses);
}

void DiveWriter::write_text(const std::string& name, const std::string& content) {
  const fs::path file = partial_ / name;
  make_folder(file.parent_path());
  io::write_text_file(file, content);
}

void DiveWriter::finish() {
  std::error_code error;
  if (stamps_.empty()) {
    fs::remove_all(partial_ / kImages, error);
  } else {
    write_text("mav0/cam0/data.csv", images_csv_);
  }
  fs::remove_all(folder_, error);
  fs::rename(partial_, folder_, error);
  if (error) fail_run("{}: cannot be created: {}", folder_.string(), error.message());
  finished_ = true;
}

std::string camera_yaml(const CameraModel::Parameters& camera, double rate_hz,
                        const std::string& note, const std::string& pose) {
  std::string yaml = fmt::format(
      "# {}\ncam0:\n  rate_hz: {:.6g}\n  intrinsics: [{:.9g}, {:.9g}, {:.9g}, {:.9g}]\n", note,
      rate_hz, camera.fx, camera.fy, camera.cx, camera.cy);
  if (camera.distortion != Distortion::none) {
    yaml += fmt::format("  distortion: {}\n  coefficients: [{:.9g}]\n",
                        lens_name(camera.distortion), fmt::join(coefficients_of(camera), ", "));
  }
  return yaml + fmt::format("  resolution: [{}, {}]\n  {}\n", camera.width, camera.height, pose);
}

std::string imu_yaml(double rate_hz, const std::string& note) {
  return fmt::format(
      "# {}\nimu0:\n  rate_hz: {:.6g}\n  gyro_noise_density: 1.0e-3\n  accel_noise_density: "
      "1.0e-2\n  gyro_random_walk: 1.0e-5\n  accel_random_walk: 1.0e-4\n",
      note, rate_hz);
}

}  // namespace apvi::importer
