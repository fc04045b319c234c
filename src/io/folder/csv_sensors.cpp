// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/csv_sensors.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <initializer_list>
#include <limits>
#include <string_view>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/text.hpp"
#include "io/folder/dvl_validity.hpp"
#include "io/folder/image_decode.hpp"
#include "io/folder/imu_unit.hpp"
#include "io/folder/plausible_source.hpp"
#include "io/folder/pressure_unit.hpp"
#include "io/rosbag/navsat.hpp"
#include "sensors/camera_mask.hpp"

namespace apvi::io {
namespace {

namespace fs = std::filesystem;
using Quantity3 = std::array<Quantity, 3>;
using Parse = std::function<std::optional<SensorEvent>(const CsvFile&, Stamp)>;
// Reads ahead, before the first row, what only the whole file tells.
using Prepare = std::function<void(CsvFile&)>;

const CsvFile::Names kGyroX = {"w_x",    "w_rs_s_x", "wx",    "ang_vel_x", "angular_velocity_x",
                               "gyro_x", "gyr_x",    "gyrox", "gyrx",      "omega_x"};
const CsvFile::Names kGyroY = {"w_y",    "w_rs_s_y", "wy",    "ang_vel_y", "angular_velocity_y",
                               "gyro_y", "gyr_y",    "gyroy", "gyry",      "omega_y"};
const CsvFile::Names kGyroZ = {"w_z",    "w_rs_s_z", "wz",    "ang_vel_z", "angular_velocity_z",
                               "gyro_z", "gyr_z",    "gyroz", "gyrz",      "omega_z"};
const CsvFile::Names kAccelX = {"a_x",   "a_rs_s_x", "ax",   "lin_acc_x", "linear_acceleration_x",
                                "acc_x", "accel_x",  "accx", "accelx",    "acceleration_x"};
const CsvFile::Names kAccelY = {"a_y",   "a_rs_s_y", "ay",   "lin_acc_y", "linear_acceleration_y",
                                "acc_y", "accel_y",  "accy", "accely",    "acceleration_y"};
const CsvFile::Names kAccelZ = {"a_z",   "a_rs_s_z", "az",   "lin_acc_z", "linear_acceleration_z",
                                "acc_z", "accel_z",  "accz", "accelz",    "acceleration_z"};
const CsvFile::Names kVelocityX = {"v_x", "vx", "vel_x", "velocity_x"};
const CsvFile::Names kVelocityY = {"v_y", "vy", "vel_y", "velocity_y"};
const CsvFile::Names kVelocityZ = {"v_z", "vz", "vel_z", "velocity_z"};
const CsvFile::Names kPressure = {"pressure", "fluid_pressure", "press", "absolute_pressure",
                                  "abs_pressure"};
const CsvFile::Names kDepth = {"depth"};

// Converts the rows of a CSV file by a function that returns nullopt for a malformed row.
class CsvSource : public SampleSource {
 public:
  CsvSource(CsvFile file, Parse parse, Prepare prepare)
      : file_(std::move(file)), parse_(std::move(parse)), prepare_(std::move(prepare)) {}

  SourceState next(SensorEvent& event) override {
    if (prepare_) std::exchange(prepare_, nullptr)(file_);
    if (!file_.next()) return SourceState::end;
    if (file_.problem()) return SourceState::malformed;
    auto parsed = parse_(file_, Stamp{*file_.stamp_ns()});
    if (!parsed) return SourceState::malformed;
    event = std::move(*parsed);
    return SourceState::sample;
  }
  std::string where() const override { return file_.where(); }
  std::pair<std::string, std::string> problem() const override {
    if (const auto problem = file_.problem()) return {problem->kind, problem->text};
    if (const auto problem = file_.cell_problem()) return {problem->kind, problem->text};
    const auto image = file_.find({"filename"});
    if (image) return {"no such image file", std::string(file_.cell(*image))};
    return {};
  }
  double fraction() const override { return file_.fraction(); }
  std::optional<StampSummary> stamp_summary() override { return file_.stamp_summary(); }
  void set_stamp_power(int power) override { file_.set_stamp_power(power); }

 private:
  CsvFile file_;
  Parse parse_;
  Prepare prepare_;
};

std::unique_ptr<SampleSource> make_source(CsvFile file, Parse parse, Prepare prepare = {}) {
  return std::make_unique<CsvSource>(std::move(file), std::move(parse), std::move(prepare));
}

std::optional<Eigen::Vector3d> vector_of(const CsvFile& row, const Quantity3& quantities) {
  Eigen::Vector3d vector;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto number = row.number(quantities[i]);
    if (!number) return std::nullopt;
    vector[static_cast<Eigen::Index>(i)] = *number;
  }
  return vector;
}

std::optional<double> number_in(const CsvFile& row, const std::optional<Quantity>& quantity) {
  if (!quantity) return std::nullopt;
  return row.number(*quantity);
}

bool is_one_of(std::string_view word, std::initializer_list<std::string_view> words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

enum class Flag { absent, yes, no, malformed };

Flag flag_in(const CsvFile& row, std::optional<std::size_t> column) {
  if (!column || row.cell(*column).empty()) return Flag::absent;
  const std::string word = text::to_lower(row.cell(*column));
  // A and V are the status of NMEA sentences and of PD6.
  if (is_one_of(word, {"true", "t", "yes", "y", "valid", "ok", "a"})) return Flag::yes;
  if (is_one_of(word, {"false", "f", "no", "n", "invalid", "v"})) return Flag::no;
  const auto number = row.number(*column);  // pandas writes 1.0 and 0.0, and nan for gaps
  if (number && std::isnan(*number)) return Flag::absent;
  if (number == 1.0) return Flag::yes;
  if (number == 0.0) return Flag::no;
  row.refuse(*column, "is not 0 or 1");
  return Flag::malformed;
}

struct ImuColumns {
  Quantity3 gyro;
  Quantity3 accel;
};

ImuColumns imu_columns(const CsvFile& file) {
  using enum Dimension;
  const Quantity3 gyro = {file.require_quantity(kGyroX, angular_rate),
                          file.require_quantity(kGyroY, angular_rate),
                          file.require_quantity(kGyroZ, angular_rate)};
  const Quantity3 accel = {file.require_quantity(kAccelX, acceleration),
                           file.require_quantity(kAccelY, acceleration),
                           file.require_quantity(kAccelZ, acceleration)};
  return {gyro, accel};
}

std::optional<SensorEvent> parse_imu(const CsvFile& row, Stamp stamp, const ImuColumns& columns,
                                     const ImuFactors& factors) {
  const auto w = vector_of(row, columns.gyro);
  const auto a = vector_of(row, columns.accel);
  if (!w || !a) return std::nullopt;
  return ImuSample{stamp, factors.gyro * *w, factors.accel * *a};
}

struct DvlColumns {
  struct Beam {
    std::optional<Quantity> velocity;
    std::optional<Quantity> range;
    std::optional<std::size_t> valid;
  };
  Quantity3 velocity;
  std::optional<Quantity> figure_of_merit;
  std::optional<Quantity> altitude;
  std::optional<std::size_t> valid;
  std::optional<std::size_t> track;  // what the velocity is against: water or bottom
  std::array<Beam, kDvlBeams> beams;
};

DvlColumns dvl_columns(const CsvFile& file) {
  DvlColumns c;
  using enum Dimension;
  c.velocity = {file.require_quantity(kVelocityX, speed), file.require_quantity(kVelocityY, speed),
                file.require_quantity(kVelocityZ, speed)};
  c.figure_of_merit = file.find_quantity({"figure_of_merit", "fom"}, speed);
  c.altitude = file.find_quantity({"altitude"}, length);
  c.valid = file.find({"valid", "velocity_valid", "vel_valid", "is_valid", "bottom_lock"});
  c.track = file.find({"tracking_mode", "velocity_mode", "type"});
  for (std::size_t i = 0; i < kDvlBeams; ++i) {
    // Beams are numbered from 0 here, from 1 in the Tank data set.
    const std::string first = fmt::format("beam{}_v", i);
    const std::string second = fmt::format("b{}", i + 1);
    const std::string third = fmt::format("beam{}_vel", i + 1);
    c.beams[i].velocity = file.find_quantity({first, second, third}, speed);
    c.beams[i].range = file.find_quantity({fmt::format("beam{}_range", i)}, length);
    c.beams[i].valid = file.find({fmt::format("beam{}_valid", i)});
  }
  return c;
}

// False when a cell of the beam is neither a number nor a flag.
bool parse_beam(const CsvFile& row, const DvlColumns::Beam& columns, std::optional<DvlBeam>& beam) {
  const Flag valid = flag_in(row, columns.valid);
  if (valid == Flag::malformed) return false;
  if (!columns.velocity || row.cell(columns.velocity->column).empty()) return true;
  const auto velocity = number_in(row, columns.velocity);
  if (!velocity) return false;
  beam = DvlBeam{
      .velocity = *velocity, .range = number_in(row, columns.range), .valid = valid != Flag::no};
  return true;
}

// The words of Water Linked's reports, and the mode of marine_acoustic_msgs.
bool is_water_track(const CsvFile& row, const std::optional<std::size_t>& column) {
  if (!column) return false;
  const std::string word = text::to_lower(row.cell(*column));
  const bool is_mode = row.column_name(*column).ends_with("velocity_mode");
  return word.find("water") != std::string::npos || (is_mode && word == "2");
}

std::optional<SensorEvent> parse_dvl(const CsvFile& row, Stamp stamp, const DvlColumns& columns) {
  DvlSample sample;
  sample.stamp = stamp;
  const Flag valid = flag_in(row, columns.valid);
  if (valid == Flag::malformed) return std::nullopt;
  const auto velocity = vector_of(row, columns.velocity);
  if (!velocity && valid != Flag::no) return std::nullopt;
  sample.velocity = velocity.value_or(Eigen::Vector3d::Zero());
  sample.figure_of_merit = number_in(row, columns.figure_of_merit);
  sample.altitude = number_in(row, columns.altitude);
  for (std::size_t i = 0; i < kDvlBeams; ++i) {
    if (!parse_beam(row, columns.beams[i], sample.beams[i])) return std::nullopt;
  }
  sample.valid = valid == Flag::absent ? infer_validity(sample) : valid == Flag::yes;
  sample.valid = sample.valid && !is_water_track(row, columns.track);
  clear_placeholder_values(sample);
  return sample;
}

PressureScale read_pressures(CsvFile& file, const Quantity& column, PressureSource source,
                             const MotionReader& read_motion) {
  std::vector<double> values;
  std::vector<PressureReading> readings;
  file.look_ahead([&] {
    const auto value = file.number(column.column);
    if (!value) return true;
    values.push_back(*value);
    const auto stamp = file.stamp_ns();
    if (stamp && std::isfinite(*value)) readings.push_back({Stamp{*stamp}, *value});
    return true;
  });
  if (source.unit == PressureUnit::automatic && read_motion) {
    const auto motion = read_motion();
    if (motion) source.growth_per_meter = motion->growth_per_meter(readings);
  }
  return evaluate_pressure(std::move(values), source);
}

// Latitude, longitude and altitude as meters east, north and up of the first fix.
std::unique_ptr<SampleSource> csv_geodetic(CsvFile file, std::size_t latitude) {
  const std::array<std::size_t, 3> columns = {
      latitude, file.require_column({"longitude", "lon", "lng", "long"}),
      file.require_column({"altitude", "alt", "height"})};
  const auto origin = std::make_shared<std::optional<GeodeticPosition>>();
  return make_source(std::move(file),
                     [=](const CsvFile& row, Stamp stamp) -> std::optional<SensorEvent> {
                       std::array<double, 3> v{};
                       for (std::size_t i = 0; i < 3; ++i) {
                         const auto number = row.number(columns[i]);
                         if (!number) return std::nullopt;
                         v[i] = *number;
                       }
                       const GeodeticPosition fix{v[0], v[1], v[2]};
                       if (!is_fix(fix)) row.refuse(columns[0], "is no latitude of a fix");
                       if (!is_fix(fix)) return std::nullopt;
                       if (!*origin) *origin = fix;
                       return GnssSample{stamp, east_north_up(fix, **origin)};
                     });
}

}  // namespace

CsvKinds csv_kinds(const CsvFile& file) {
  using enum Dimension;
  const auto has = [&](Dimension dimension, std::initializer_list<CsvFile::Names> columns) {
    return std::ranges::all_of(columns, [&](CsvFile::Names names) {
      return file.find_quantity(names, dimension).has_value();
    });
  };
  return {.imu = has(angular_rate, {kGyroX, kGyroY, kGyroZ}) &&
                 has(acceleration, {kAccelX, kAccelY, kAccelZ}),
          .dvl = has(speed, {kVelocityX, kVelocityY, kVelocityZ}),
          .pressure = has(Dimension::pressure, {kPressure}),
          .depth = has(length, {kDepth})};
}

std::unique_ptr<SampleSource> csv_imu(CsvFile file) {
  const ImuColumns columns = imu_columns(file);
  const StatedUnits stated{.gyro = columns.gyro[0].has_unit, .accel = columns.accel[0].has_unit};
  const auto factors = std::make_shared<ImuFactors>();  // from what the columns hold to SI
  return make_source(
      std::move(file),
      [=](const CsvFile& row, Stamp stamp) { return parse_imu(row, stamp, columns, *factors); },
      [=](CsvFile& whole) {
        ImuEvidence evidence;
        whole.look_ahead([&] {
          const auto w = vector_of(whole, columns.gyro);
          const auto a = vector_of(whole, columns.accel);
          const auto stamp = whole.stamp_ns();
          if (w && a && stamp) evidence.add({Stamp{*stamp}, *w, *a});
          return true;
        });
        *factors = imu_factors(evidence, stated, whole.name());
      });
}

std::unique_ptr<SampleSource> csv_imu_as_written(CsvFile file) {
  const ImuColumns columns = imu_columns(file);
  return make_source(std::move(file), [columns](const CsvFile& row, Stamp stamp) {
    return parse_imu(row, stamp, columns, {});
  });
}

std::unique_ptr<SampleSource> csv_dvl(CsvFile file) {
  const DvlColumns columns = dvl_columns(file);
  const auto reported = std::make_shared<bool>(false);
  return make_source(std::move(file), [=](const CsvFile& row, Stamp stamp) {
    if (is_water_track(row, columns.track) && !std::exchange(*reported, true)) {
      log::warning("{}: water track: velocities against the water are not used", row.where());
    }
    return parse_dvl(row, stamp, columns);
  });
}

std::unique_ptr<SampleSource> csv_pressure(CsvFile file, PressureUnit unit, double atmospheric_pa,
                                           const MotionReader& motion) {
  const Quantity column = file.require_quantity(kPressure, Dimension::pressure);
  PressureSource source{.name = file.name(), .unit = unit, .atmospheric_pa = atmospheric_pa};
  if (unit == PressureUnit::automatic && column.has_unit) source.unit = unit_of(column.to_si);
  const auto scale = std::make_shared<PressureScale>();
  auto rows = make_source(
      std::move(file),
      [=](const CsvFile& row, Stamp stamp) -> std::optional<SensorEvent> {
        const auto value = row.number(column.column);
        if (!value) return std::nullopt;
        return PressureSample{stamp, scale->pascal(*value)};
      },
      [=](CsvFile& whole) { *scale = read_pressures(whole, column, source, motion); });
  return std::make_unique<PlausibleSource>(std::move(rows), scale);
}

std::unique_ptr<SampleSource> csv_depth(CsvFile file) {
  // The Tank data set has a height column instead, with opposite sign.
  const auto depth = file.find_quantity(kDepth, Dimension::length);
  const Quantity column =
      depth ? *depth : file.require_quantity({"depth", "pos_z"}, Dimension::length);
  const double sign = depth ? 1.0 : -1.0;
  return make_source(std::move(file),
                     [=](const CsvFile& row, Stamp stamp) -> std::optional<SensorEvent> {
                       const auto value = row.number(column);
                       if (!value) return std::nullopt;
                       return PressureDepthSample{stamp, sign * *value};
                     });
}

std::unique_ptr<SampleSource> csv_gnss(CsvFile file) {
  if (const auto latitude = file.find({"latitude", "lat"})) {
    return csv_geodetic(std::move(file), *latitude);
  }
  const Quantity3 columns = {file.require_quantity({"east"}, Dimension::length),
                             file.require_quantity({"north"}, Dimension::length),
                             file.require_quantity({"up"}, Dimension::length)};
  return make_source(std::move(file), [=](const CsvFile& row, Stamp stamp) {
    const auto p = vector_of(row, columns);
    return p ? std::optional<SensorEvent>(GnssSample{stamp, *p}) : std::nullopt;
  });
}

namespace {

bool is_file(const fs::path& path) {
  std::error_code unreadable;
  return fs::is_regular_file(path, unreadable);
}

// Names may have the folder of the computer that recorded them, or the ending that the images had
// before they were converted.
std::optional<fs::path> find_image(const fs::path& images, const std::string& name) {
  if (is_file(images / name)) return images / name;
  const fs::path plain = images / name.substr(name.find_last_of("/\\") + 1);
  if (is_file(plain)) return plain;
  for (const char* ending : {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm"}) {
    const fs::path other = fs::path(plain).replace_extension(ending);
    if (is_file(other)) return other;
  }
  return std::nullopt;
}

}  // namespace

std::unique_ptr<SampleSource> csv_camera(CsvFile file, const fs::path& images, int camera) {
  const std::size_t column = file.require_column({"filename"});
  const auto depth = std::make_shared<BitDepth>();
  const fs::path masks = images.parent_path() / "masks";
  const bool has_masks = fs::is_directory(masks);
  return make_source(
      std::move(file), [=](const CsvFile& row, Stamp stamp) -> std::optional<SensorEvent> {
        if (row.cell(column).empty()) return std::nullopt;
        const auto path = find_image(images, std::string(row.cell(column)));
        if (!path) return std::nullopt;
        ImageFrame frame{stamp, camera,
                         [file = *path, depth] { return decode_image_file(file, *depth); }};
        if (!has_masks) return frame;
        if (const auto mask = find_mask(masks, std::string(row.cell(column)))) {
          frame.mask = [file = *mask] { return read_mask(file); };
        }
        return frame;
      });
}

}  // namespace apvi::io
