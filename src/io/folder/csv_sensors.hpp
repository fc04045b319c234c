// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <memory>

#include "apvi/io/sequence.hpp"
#include "io/folder/csv_file.hpp"
#include "io/folder/vertical_motion.hpp"
#include "io/sample_source.hpp"

/// Sensor sources for CSV files. Each function reads the header and throws InputError when a
/// required column is missing. An empty cell means "not reported".
namespace apvi::io {

/// The sensors whose required columns a file has; one file may have several.
struct CsvKinds {
  bool imu = false;
  bool dvl = false;
  bool pressure = false;
  bool depth = false;
};
/// Throws InputError for a unit that is not known.
CsvKinds csv_kinds(const CsvFile& file);

/// Accelerations in g, milli-g, cm/s² or mm/s² without a unit in the header are converted, see
/// `accel_factor`.
std::unique_ptr<SampleSource> csv_imu(CsvFile file);
/// The same without conversion of accelerations, and without a warning.
std::unique_ptr<SampleSource> csv_imu_as_written(CsvFile file);
std::unique_ptr<SampleSource> csv_dvl(CsvFile file);
/// `unit` automatic: the unit in the header, else inferred from all values, see
/// `evaluate_pressure`, with the help of `motion` if there is one. `atmospheric_pa` is added to
/// readings above the atmosphere.
std::unique_ptr<SampleSource> csv_pressure(CsvFile file, PressureUnit unit,
                                           double atmospheric_pa = 101325.0,
                                           const MotionReader& motion = {});
std::unique_ptr<SampleSource> csv_depth(CsvFile file);
std::unique_ptr<SampleSource> csv_gnss(CsvFile file);
/// Images by file name in the folder `images`; a row whose file is missing is malformed.
std::unique_ptr<SampleSource> csv_camera(CsvFile file, const std::filesystem::path& images,
                                         int camera);

}  // namespace apvi::io
