// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <memory>

#include "apvi/io/sequence.hpp"
#include "io/csv_file.hpp"
#include "io/sample_source.hpp"

/// The sensors of a folder of csv files. Each function reads the header and throws InputError when
/// a column that the sensor cannot do without is missing. An empty cell means "not reported".
namespace apvi::io {

std::unique_ptr<SampleSource> csv_imu(CsvFile file);
std::unique_ptr<SampleSource> csv_dvl(CsvFile file);
/// `unit` automatic: the header's unit, or else by the size of the first number.
std::unique_ptr<SampleSource> csv_pressure(CsvFile file, PressureUnit unit);
std::unique_ptr<SampleSource> csv_depth(CsvFile file);
std::unique_ptr<SampleSource> csv_gnss(CsvFile file);
/// Images by file name, found in `images`; a row whose file is not there counts as malformed.
std::unique_ptr<SampleSource> csv_camera(CsvFile file, std::filesystem::path images, int camera);

}  // namespace apvi::io
