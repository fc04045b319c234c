// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/csv_sensors.hpp"

#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include "apvi/core/error.hpp"
#include "core/text.hpp"
#include "io/folder/dvl_validity.hpp"
#include "io/folder/image_decode.hpp"
#include "io/folder/pressure_unit.hpp"

namespace apvi::io {
namespace {

namespace fs = std::filesystem;
using Columns3 = std::array<std::size_t, 3>;
using Parse = std::function<std::optional<SensorEvent>(const CsvFile&, Stamp)>;

// Converts the rows of a CSV file by a function that returns nullopt for a malformed row.
class CsvSource : public SampleSource {
 public:
  CsvSource(CsvFile file, Parse parse) : file_(std::move(file)), parse_(std::move(parse)) {}

  SourceState next(SensorEvent& event) override {
    if (!file_.next()) return SourceState::end;
    const auto ns = file_.stamp_ns();
    if (!ns || !file_.complete()) return SourceState::malformed;
    auto parsed = parse_(file_, Stamp{*ns});
    if (!parsed) return SourceState::malformed;
    event = std::move(*parsed);
    return SourceState::sample;
  }
  std::string where() const override { return file_.where(); }
  double fraction() const override { return file_.fraction(); }

 private:
  CsvFile file_;
  Parse parse_;
};

std::unique_ptr<SampleSource> make_source(CsvFile file, Parse parse) {
  return std::make_unique<CsvSource>(std::move(file), std::move(parse));
}

std::optional<Eigen::Vector3d> vector_of(const CsvFile& row, const Columns3& columns) {
  Eigen::Vector3d vector;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto number = text::parse_double(row.cell(columns[i]));
    if (!number) return std::nullopt;
    vector[static_cast<Eigen::Index>(i)] = *number;
  }
  return vector;
}

std::optional<double> number_in(const CsvFile& row, std::optional<std::size_t> column) {
  if (!column) return std::nullopt;
  return text::parse_double(row.cell(*column));
}

enum class Flag { absent, yes, no, malformed };

Flag flag_in(const CsvFile& row, std::optional<std::size_t> column) {
  if (!column || row.cell(*column).empty()) return Flag::absent;
  const std::string word = text::to_lower(row.cell(*column));
  if (word == "1" || word == "true") return Flag::yes;
  if (word == "0" || word == "false") return Flag::no;
  return Flag::malformed;
}

struct DvlColumns {
  struct Beam {
    std::optional<std::size_t> velocity;
    std::optional<std::size_t> range;
    std::optional<std::size_t> valid;
  };
  Columns3 velocity;
  std::optional<std::size_t> figure_of_merit;
  std::optional<std::size_t> altitude;
  std::optional<std::size_t> valid;
  std::array<Beam, kDvlBeams> beams;
};

DvlColumns dvl_columns(const CsvFile& file) {
  DvlColumns c;
  c.velocity = {file.require_column({"v_x", "vx", "vel_x"}),
                file.require_column({"v_y", "vy", "vel_y"}),
                file.require_column({"v_z", "vz", "vel_z"})};
  c.figure_of_merit = file.find({"figure_of_merit", "fom"});
  c.altitude = file.find({"altitude"});
  c.valid = file.find({"valid", "velocity_valid"});
  for (std::size_t i = 0; i < kDvlBeams; ++i) {
    // Beams are numbered from 0 here, from 1 in the Tank data set.
    c.beams[i].velocity = file.find(
        {fmt::format("beam{}_v", i), fmt::format("b{}", i + 1), fmt::format("beam{}_vel", i + 1)});
    c.beams[i].range = file.find({fmt::format("beam{}_range", i)});
    c.beams[i].valid = file.find({fmt::format("beam{}_valid", i)});
  }
  return c;
}

// False when a cell of the beam is neither a number nor a flag.
bool parse_beam(const CsvFile& row, const DvlColumns::Beam& columns, std::optional<DvlBeam>& beam) {
  const Flag valid = flag_in(row, columns.valid);
  if (valid == Flag::malformed) return false;
  if (!columns.velocity || row.cell(*columns.velocity).empty()) return true;
  const auto velocity = number_in(row, columns.velocity);
  if (!velocity) return false;
  beam = DvlBeam{
      .velocity = *velocity, .range = number_in(row, columns.range), .valid = valid != Flag::no};
  return true;
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
  clear_placeholder_values(sample);
  return sample;
}

}  // namespace

std::unique_ptr<SampleSource> csv_imu(CsvFile file) {
  const Columns3 gyro = {file.require_column({"w_x", "w_rs_s_x", "wx", "ang_vel_x"}),
                         file.require_column({"w_y", "w_rs_s_y", "wy", "ang_vel_y"}),
                         file.require_column({"w_z", "w_rs_s_z", "wz", "ang_vel_z"})};
  const Columns3 accel = {file.require_column({"a_x", "a_rs_s_x", "ax", "lin_acc_x"}),
                          file.require_column({"a_y", "a_rs_s_y", "ay", "lin_acc_y"}),
                          file.require_column({"a_z", "a_rs_s_z", "az", "lin_acc_z"})};
  return make_source(std::move(file), [=](const CsvFile& row, Stamp stamp) {
    const auto w = vector_of(row, gyro);
    const auto a = vector_of(row, accel);
    return w && a ? std::optional<SensorEvent>(ImuSample{stamp, *w, *a}) : std::nullopt;
  });
}

std::unique_ptr<SampleSource> csv_dvl(CsvFile file) {
  const DvlColumns columns = dvl_columns(file);
  return make_source(std::move(file), [columns](const CsvFile& row, Stamp stamp) {
    return parse_dvl(row, stamp, columns);
  });
}

std::unique_ptr<SampleSource> csv_pressure(CsvFile file, PressureUnit unit) {
  const std::size_t column = file.require_column({"pressure", "fluid_pressure"});
  if (unit == PressureUnit::automatic && !file.unit(column).empty()) {
    const auto written = pressure_unit_of(file.unit(column));
    if (!written) {
      fail_input("{}: unknown pressure unit [{}]; use [Pa], [hPa] or [kPa]", file.name(),
                 file.unit(column));
    }
    unit = *written;
  }
  PressureScale scale(unit);
  return make_source(
      std::move(file),
      [column, scale](const CsvFile& row, Stamp stamp) mutable -> std::optional<SensorEvent> {
        const auto value = number_in(row, column);
        if (!value) return std::nullopt;
        return PressureSample{stamp, scale.to_pascal(*value, row.name())};
      });
}

std::unique_ptr<SampleSource> csv_depth(CsvFile file) {
  // The Tank data set has a height column instead, with opposite sign.
  const auto depth = file.find({"depth"});
  const std::size_t column = depth ? *depth : file.require_column({"depth", "pos_z"});
  const double sign = depth ? 1.0 : -1.0;
  return make_source(std::move(file),
                     [=](const CsvFile& row, Stamp stamp) -> std::optional<SensorEvent> {
                       const auto value = number_in(row, column);
                       if (!value) return std::nullopt;
                       return PressureDepthSample{stamp, sign * *value};
                     });
}

std::unique_ptr<SampleSource> csv_gnss(CsvFile file) {
  const Columns3 columns = {file.require_column({"east"}), file.require_column({"north"}),
                            file.require_column({"up"})};
  return make_source(std::move(file), [=](const CsvFile& row, Stamp stamp) {
    const auto p = vector_of(row, columns);
    return p ? std::optional<SensorEvent>(GnssSample{stamp, *p}) : std::nullopt;
  });
}

std::unique_ptr<SampleSource> csv_camera(CsvFile file, fs::path images, int camera) {
  const std::size_t column = file.require_column({"filename"});
  return make_source(std::move(file),
                     [=](const CsvFile& row, Stamp stamp) -> std::optional<SensorEvent> {
                       if (row.cell(column).empty()) return std::nullopt;
                       const fs::path path = images / std::string(row.cell(column));
                       std::error_code unreadable;
                       if (!fs::is_regular_file(path, unreadable)) return std::nullopt;
                       return ImageFrame{stamp, camera, [path] { return decode_image_file(path); }};
                     });
}

}  // namespace apvi::io
