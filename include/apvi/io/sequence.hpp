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

enum class DatasetFormat { automatic, folder, euroc, tank, rosbag };
/// How images are hidden: turned black, or never delivered.
enum class Blackout { black, dropped };
enum class PressureUnit { automatic, pa, hpa, kpa };

/// Names of topics in a bag; an empty one is guessed from the message type and usual names.
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
    v("dvl", dvl, "Water Linked DVL, TwistWithCovarianceStamped or Odometry (its twist)");
    v("pressure", pressure, "sensor_msgs/FluidPressure");
    v("depth", depth, "nav_msgs/Odometry whose pose.position.z is minus the depth");
    v("cam0", cam0, "sensor_msgs/Image or CompressedImage");
    v("cam1", cam1, "the same, second camera");
    v("reference", reference, "nav_msgs/Odometry or PoseStamped used as ground truth");
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
  Blackout blackout = Blackout::black;
  PressureUnit pressure_unit = PressureUnit::automatic;
  double max_time_jump_s = 60.0;
  TopicConfig topics;

  template <typename V>
  void visit(V& v) {
    using config::Choices;
    using config::Range;
    v("path", path, "folder or .bag file");
    v("format", format,
      Choices<DatasetFormat>{{"auto", DatasetFormat::automatic},
                             {"folder", DatasetFormat::folder},
                             {"euroc", DatasetFormat::euroc},
                             {"tank", DatasetFormat::tank},
                             {"rosbag", DatasetFormat::rosbag}},
      "how the data set is laid out");
    v("rig", rig, "calibration file instead of the data set's own rig.yaml");
    v("start_s", start_s, Range{0.0, 1e9}, "skip this much of the beginning [s]");
    v("duration_s", duration_s, Range{0.0, 1e9}, "use this much, 0 for all [s]");
    v("blackout_s", blackout_s, "spans [from, to] after the start whose images are hidden [s]");
    v("blackout", blackout,
      Choices<Blackout>{{"black", Blackout::black}, {"dropped", Blackout::dropped}},
      "what becomes of hidden images: black ones, or none");
    v("pressure_unit", pressure_unit,
      Choices<PressureUnit>{{"auto", PressureUnit::automatic},
                            {"Pa", PressureUnit::pa},
                            {"hPa", PressureUnit::hpa},
                            {"kPa", PressureUnit::kpa}},
      "of the pressure sensor's numbers; auto judges by their size");
    v("max_time_jump_s", max_time_jump_s, Range{0.1, 1e9},
      "a single sample farther from its neighbours than this is a broken stamp [s]");
    v("topics", topics, "topics of a bag");
  }
};

/// Why a sample did not reach the estimator.
enum class DropReason { malformed, not_finite, out_of_order, duplicate_stamp, broken_stamp };
std::string_view to_string(DropReason reason);

/// What became of one sensor's samples.
struct StreamReport {
  std::size_t delivered = 0;
  std::map<DropReason, std::size_t> dropped;
  std::map<DropReason, std::string> first_drop;  ///< "file:line" or stamp of the first of each kind
};

/// A recording, as one time-ordered stream of samples. Reading is lazy: the memory needed does not
/// grow with the length of the recording (images are decoded when asked for).
///
/// Samples that no estimator could use (malformed, NaN, stamps that run backwards or jump away for
/// a single sample) are dropped, counted in `report` and logged once per kind. A DVL sample that
/// says it is invalid is data, and is delivered.
class SequenceReader {
 public:
  virtual ~SequenceReader() = default;

  /// The calibration stored with the recording; null when there is none.
  virtual const config::Node& rig() const = 0;
  /// The next event in order of time; nothing at the end.
  virtual std::optional<SensorEvent> next() = 0;
  /// How much has been read, in [0, 1].
  virtual double fraction() const = 0;
  /// Per sensor: "imu", "dvl", "pressure", "depth", "camera", "gnss".
  virtual const std::map<std::string, StreamReport>& report() const = 0;
  /// Ground truth or another independent trajectory stored with the recording (GNSS when there is
  /// nothing better).
  virtual std::optional<Trajectory> reference() const = 0;
};

/// Opens a recording and restricts it to the configured span. `sensors` (of "camera", "imu", "dvl",
/// "pressure"; empty for all) says what to read; "pressure" covers depth sensors, GNSS is read only
/// with an empty list. Throws InputError when the path does not exist, the format is not
/// recognised, a needed file is missing or has no header.
std::unique_ptr<SequenceReader> open_sequence(const DatasetConfig& config,
                                              const std::vector<std::string>& sensors);

}  // namespace apvi::io
