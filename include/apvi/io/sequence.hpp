// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/core/stamp.hpp"
#include "apvi/geometry/trajectory.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::io {

enum class DatasetFormat { automatic, folder, euroc, tank, rosbag, rosbag2 };
/// How images are blacked out: replaced by black images, or dropped.
enum class Blackout { black, dropped };
enum class PressureUnit { automatic, pa, hpa, kpa, mpa, bar, dbar, psi };

/// Topic names in a bag; an empty one is inferred from message types and common topic names.
struct TopicConfig {
  std::string imu;
  std::string dvl;
  std::string pressure;
  std::string depth;
  std::string cam0;
  std::string cam1;
  std::string reference;

  template <typename V>
  void visit(V& v) {
    v("imu", imu, "sensor_msgs/Imu");
    v("dvl", dvl, "DVL message of a vendor, TwistWithCovarianceStamped or Odometry (its twist)");
    v("pressure", pressure, "sensor_msgs/FluidPressure");
    v("depth", depth, "nav_msgs/Odometry whose pose.position.z is minus the depth");
    v("cam0", cam0, "sensor_msgs/Image or CompressedImage, first camera");
    v("cam1", cam1, "sensor_msgs/Image or CompressedImage, second camera");
    v("reference", reference,
      "nav_msgs/Odometry, PoseStamped or NavSatFix used as the reference trajectory");
  }
};

/// Times added to the stamps of sensors whose clock is not that of the IMU [s].
struct ClockShiftConfig {
  double camera = 0.0;
  double dvl = 0.0;
  double pressure = 0.0;

  template <typename V>
  void visit(V& v) {
    const config::Range any{-4.5e9, 4.5e9};  // from the start of a device to times since 1970
    v("camera", camera, any, "added to the stamps of all cameras [s]");
    v("dvl", dvl, any, "added to the stamps of the DVL [s]");
    v("pressure", pressure, any, "added to the stamps of the pressure or depth sensor [s]");
  }
};

/// The `dataset` section of a run's configuration.
struct DatasetConfig {
  std::string path;
  DatasetFormat format = DatasetFormat::automatic;
  std::string rig;  ///< calibration file to use instead of the data set's own
  double start_s = 0.0;
  double duration_s = 0.0;
  std::vector<std::array<double, 2>> blackout_s;
  Blackout blackout_mode = Blackout::black;
  PressureUnit pressure_unit = PressureUnit::automatic;
  double max_time_jump_s = 60.0;
  ClockShiftConfig clock_shift_s;
  TopicConfig topics;
  std::string message_definitions;

  template <typename V>
  void visit(V& v) {
    using config::Choices;
    using config::Range;
    v("path", path, "recording: a folder, or a .bag, .mcap or .db3 file");
    v("format", format,
      Choices<DatasetFormat>{{"auto", DatasetFormat::automatic},
                             {"folder", DatasetFormat::folder},
                             {"euroc", DatasetFormat::euroc},
                             {"tank", DatasetFormat::tank},
                             {"rosbag", DatasetFormat::rosbag},
                             {"rosbag2", DatasetFormat::rosbag2}},
      "layout of the recording; auto detects it");
    v("rig", rig, "calibration file that replaces the recording's own rig.yaml");
    v("start_s", start_s, Range{0.0, 1e9}, "time skipped at the beginning [s]");
    v("duration_s", duration_s, Range{0.0, 1e9}, "length used; 0: to the end [s]");
    v("blackout_s", blackout_s,
      "list of spans [from, to] after the start in which images are hidden, for testing [s]");
    v("blackout_mode", blackout_mode,
      Choices<Blackout>{{"black", Blackout::black}, {"dropped", Blackout::dropped}},
      "what hidden images become: black, or dropped");
    v("pressure_unit", pressure_unit,
      Choices<PressureUnit>{{"auto", PressureUnit::automatic},
                            {"Pa", PressureUnit::pa},
                            {"hPa", PressureUnit::hpa},
                            {"mbar", PressureUnit::hpa},
                            {"kPa", PressureUnit::kpa},
                            {"MPa", PressureUnit::mpa},
                            {"bar", PressureUnit::bar},
                            {"dbar", PressureUnit::dbar},
                            {"psi", PressureUnit::psi}},
      "unit of the pressure readings; auto: the header's, else by all readings of the recording");
    v("max_time_jump_s", max_time_jump_s, Range{0.1, 1e9},
      "a single sample whose stamp is farther than this from its neighbors is dropped; a clock "
      "that is set back by more is recognized [s]");
    v("clock_shift_s", clock_shift_s,
      "for recordings with several clocks, by whole epochs too; the rest is time_offset_s of the "
      "rig");
    v("topics", topics, "topics of a bag; empty: found by message type and name");
    v("message_definitions", message_definitions,
      "folder of PACKAGE/msg/NAME.msg files, for .db3 bags that do not define their messages "
      "(before ROS 2 Iron)");
  }
};

/// Why a sample did not reach the estimator.
enum class DropReason {
  malformed,
  not_finite,
  implausible,
  out_of_order,
  duplicate_stamp,
  broken_stamp
};
std::string_view to_string(DropReason reason);

/// Sample counts of one sensor.
struct StreamReport {
  std::size_t delivered = 0;
  std::map<DropReason, std::size_t> dropped;
  std::map<DropReason, std::string> first_drop;  ///< "file:line" or stamp of the first of each kind
  Duration largest_step_back = {};  ///< of a sample that was dropped for being out of order
  /// What was read otherwise than the recording says, as text; "" as a rule.
  std::string remark = {};
};

/// A recording as one chronological stream of samples. Reading is lazy: memory does not grow with
/// the length of the recording (images are decoded on demand).
///
/// Unusable samples (malformed, NaN, decreasing stamps, single stamps with a jump) are dropped,
/// counted in `report` and logged once per kind. A DVL sample that is flagged invalid is data and
/// is delivered.
class SequenceReader {
 public:
  virtual ~SequenceReader() = default;

  /// The calibration stored with the recording; null when there is none.
  virtual const config::Node& rig() const = 0;
  /// The next event in chronological order; nullopt at the end.
  virtual std::optional<SensorEvent> next() = 0;
  /// Fraction read, in [0, 1].
  virtual double fraction() const = 0;
  /// Per sensor: "imu", "dvl", "pressure", "depth", "camera", "gnss".
  virtual const std::map<std::string, StreamReport>& report() const = 0;
  /// Ground truth or another independent trajectory stored with the recording (GNSS as a
  /// fallback).
  virtual std::optional<Trajectory> reference() const = 0;
};

/// Opens a recording and restricts it to the configured span. `sensors` (of "camera", "imu", "dvl",
/// "pressure"; empty for all) selects what to read; "pressure" covers depth sensors, GNSS is read
/// only with an empty list. Throws InputError when the path does not exist, the format is not
/// recognized, or a required file is missing or has no header.
std::unique_ptr<SequenceReader> open_sequence(const DatasetConfig& config,
                                              const std::vector<std::string>& sensors);

}  // namespace apvi::io
