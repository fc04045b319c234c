// SPDX-License-Identifier: BSD-3-Clause
#include "runs/fault_tables.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <set>
#include <utility>

#include "core/text.hpp"
#include "io/cdr_bytes.hpp"
#include "io/db3_writer.hpp"
#include "io/mcap_writer.hpp"
#include "io/rosbag2/ros2_definitions.hpp"

namespace apvi::test {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> cells(1);
  for (const char c : line) {
    if (c == ',') {
      cells.emplace_back();
    } else {
      cells.back().push_back(c);
    }
  }
  return cells;
}

std::size_t random_row(const FaultTable& table, Random& random) {
  return static_cast<std::size_t>(random.uniform() * static_cast<double>(table.rows.size()));
}

void set_some(FaultTable& table, Random& random, double part, const std::string& cell) {
  for (auto& row : table.rows) {
    if (random.uniform() < part) row[1] = cell;
  }
}

// Moves the stamps of a table's rows from a random one on.
void jump(FaultTable& table, std::int64_t from_ns, std::int64_t by_ns) {
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    const std::int64_t ns = table.stamp(i);
    if (ns >= from_ns) table.rows[i][0] = std::to_string(ns + by_ns);
  }
}

void erase_between(FaultTable& table, std::int64_t from_ns, std::int64_t to_ns) {
  std::vector<std::vector<std::string>> kept;
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    if (table.stamp(i) < from_ns || table.stamp(i) >= to_ns) kept.push_back(table.rows[i]);
  }
  table.rows = std::move(kept);
}

std::int64_t middle(const FaultyDive& dive) {
  return dive.imu.stamp(dive.imu.rows.size() / 2);
}

std::vector<FaultTable*> sensors(FaultyDive& dive) {
  return {&dive.imu, &dive.dvl, &dive.depth};
}

void rename_unit(FaultTable& table, std::size_t column, const std::string& unit, double factor) {
  const std::string& name = table.header[column];
  table.header[column] = name.substr(0, name.find(" [")) + " [" + unit + "]";
  table.scale(column, factor);
}

std::vector<Fault> harmless_faults() {
  return {
      {"CRLF", true, [](FaultyDive& d, Random&) { d.dvl.line_end = "\r\n"; }},
      {"byte order mark", true, [](FaultyDive& d, Random&) { d.imu.prefix = "\xEF\xBB\xBF"; }},
      {"semicolons", true, [](FaultyDive& d, Random&) { d.depth.separator = ';'; }},
      {"column order", true,
       [](FaultyDive& d, Random&) {
         std::swap(d.dvl.header[1], d.dvl.header[3]);
         for (auto& row : d.dvl.rows) std::swap(row[1], row[3]);
       }},
      {"a column more", true,
       [](FaultyDive& d, Random&) {
         d.depth.header.emplace_back("battery [V]");
         for (auto& row : d.depth.rows) row.emplace_back("12.1");
       }},
      {"mm/s", true,
       [](FaultyDive& d, Random&) {
         for (const std::size_t c : {1U, 2U, 3U}) rename_unit(d.dvl, c, "mm/s", 1000.0);
       }},
      {"deg/s", true,
       [](FaultyDive& d, Random&) {
         for (const std::size_t c : {1U, 2U, 3U}) rename_unit(d.imu, c, "deg/s", 57.29577951308232);
       }},
      {"bad reference rows", true,
       [](FaultyDive& d, Random& random) { set_some(d.truth, random, 0.1, "nan"); }},
  };
}

const std::vector<std::string> kImu = {"imu"};
const std::vector<std::string> kDvl = {"dvl"};
const std::vector<std::string> kDepth = {"depth", "pressure"};

std::vector<Fault> value_faults() {
  return {
      {"NaN in IMU", false,
       [](FaultyDive& d, Random& random) { set_some(d.imu, random, 0.02, "nan"); }, kImu},
      {"text in DVL", false,
       [](FaultyDive& d, Random& random) { set_some(d.dvl, random, 0.1, "error"); }, kDvl},
      {"empty cells", false,
       [](FaultyDive& d, Random& random) { set_some(d.depth, random, 0.2, ""); }, kDepth},
      {"placeholder -32.768", false,
       [](FaultyDive& d, Random& random) {
         const bool mm = d.dvl.header[1].find("mm/s") != std::string::npos;
         set_some(d.dvl, random, 0.3, mm ? "-32768" : "-32.768");
       },
       kDvl},
      {"outliers of the DVL", false,
       [](FaultyDive& d, Random& random) { set_some(d.dvl, random, 0.05, "7.5"); }, kDvl},
      {"spikes of the IMU", false,
       [](FaultyDive& d, Random& random) { set_some(d.imu, random, 0.002, "31.0"); }, kImu},
      {"spikes of the depth", false,
       [](FaultyDive& d, Random& random) { set_some(d.depth, random, 0.05, "6553.5"); }, kDepth},
      {"frozen DVL", false,
       [](FaultyDive& d, Random& random) {
         const std::size_t from = random_row(d.dvl, random);
         for (std::size_t i = from; i < d.dvl.rows.size(); ++i) {
           std::copy(d.dvl.rows[from].begin() + 1, d.dvl.rows[from].end(),
                     d.dvl.rows[i].begin() + 1);
         }
       },
       kDvl},
      {"g without a unit", false,
       [](FaultyDive& d, Random&) {
         for (const std::size_t c : {4U, 5U, 6U}) rename_unit(d.imu, c, "", 1.0 / 9.80665);
       },
       kImu},
      {"deg/s declared as rad/s", false,
       [](FaultyDive& d, Random&) {
         for (const std::size_t c : {1U, 2U, 3U}) d.imu.scale(c, 57.29577951308232);
       },
       kImu},
      {"unknown unit", false,
       [](FaultyDive& d, Random&) { rename_unit(d.dvl, 1, "furlong/fortnight", 1.0); }, kDvl},
      {"rows cut off", false,
       [](FaultyDive& d, Random& random) { d.imu.rows[random_row(d.imu, random)].resize(3); },
       kImu},
  };
}

std::vector<Fault> time_faults() {
  return {
      {"swapped rows", false,
       [](FaultyDive& d, Random& random) {
         for (int i = 0; i < 20; ++i) {
           const std::size_t row = random_row(d.imu, random);
           if (row > 0) std::swap(d.imu.rows[row], d.imu.rows[row - 1]);
         }
       },
       kImu},
      {"repeated rows", false,
       [](FaultyDive& d, Random& random) {
         for (int i = 0; i < 20; ++i) {
           const std::size_t row = random_row(d.dvl, random);
           d.dvl.rows.insert(d.dvl.rows.begin() + static_cast<std::ptrdiff_t>(row),
                             d.dvl.rows[row]);
         }
       },
       kDvl},
      {"stamps of years ahead", false,
       [](FaultyDive& d, Random& random) {
         const std::size_t row = random_row(d.imu, random);
         d.imu.rows[row][0] = std::to_string(d.imu.stamp(row) + 100'000'000 * kSecond);
       },
       kImu},
      {"clock of one sensor jumps", false,
       [](FaultyDive& d, Random&) { jump(d.dvl, middle(d), 500 * kSecond); }, kDvl},
      {"pause of all sensors", false,
       [](FaultyDive& d, Random& random) {
         const auto pause = static_cast<std::int64_t>(random.uniform(5.0, 5e4)) * kSecond;
         const std::int64_t from = middle(d);
         for (FaultTable* table : sensors(d)) jump(*table, from, pause);
         jump(d.truth, from, pause);
       },
       kImu},
      {"hole in the IMU", false,
       [](FaultyDive& d, Random& random) {
         const auto length = static_cast<std::int64_t>(random.uniform(0.1, 4.0) * 1e9);
         erase_between(d.imu, middle(d), middle(d) + length);
       },
       kImu},
      {"DVL ends early", false,
       [](FaultyDive& d, Random&) { erase_between(d.dvl, middle(d), INT64_MAX); }, kDvl},
      {"no depth", false, [](FaultyDive& d, Random&) { d.depth.rows.clear(); }, kDepth},
      {"clocks a day apart", false,
       [](FaultyDive& d, Random&) { jump(d.depth, 0, 86'400 * kSecond); }, kDepth},
      {"microseconds called nanoseconds", false,
       [](FaultyDive& d, Random&) {
         if (d.dvl.header[0] != "#timestamp [ns]") return;
         for (auto& row : d.dvl.rows) row[0] = std::to_string(std::stoll(row[0]) / 1000);
       },
       kDvl},
      {"DVL begins late", false,
       [](FaultyDive& d, Random&) { erase_between(d.dvl, 0, d.imu.stamp(0) + 4 * kSecond); }, kDvl},
      {"stamps in seconds", false,
       [](FaultyDive& d, Random&) {
         for (std::size_t i = 0; i < d.dvl.rows.size(); ++i) {
           d.dvl.rows[i][0] = fmt::format("{:.6f}", static_cast<double>(d.dvl.stamp(i)) * 1e-9);
         }
         d.dvl.header[0] = "timestamp [s]";
       },
       kDvl},
  };
}

// The numbers of a row from the second cell on; empty if one is none.
std::vector<double> numbers_of(const std::vector<std::string>& row) {
  std::vector<double> numbers;
  for (std::size_t i = 1; i < row.size(); ++i) {
    if (row[i].empty()) continue;  // not reported
    const auto number = text::parse_double(row[i]);
    if (!number) return {};
    numbers.push_back(*number);
  }
  return numbers;
}

// Adds a topic with a message for each row that has `count` numbers.
template <typename Writer, typename Fill>
void add_topic(Writer& file, const FaultTable& table, const char* topic, const std::string& type,
               std::size_t count, Fill&& fill) {
  const std::string plain = type.substr(0, type.find('/')) + type.substr(type.rfind('/'));
  const auto channel = file.add_topic(topic, type, io::ros2_definitions(plain).at(0));
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    const std::vector<double> v = numbers_of(table.rows[i]);
    const std::int64_t ns = table.stamp(i);
    if (v.size() < count || ns < 0) continue;
    CdrBytes bytes;
    fill(bytes.header(ns), v);
    file.write(channel, ns, bytes.get());
  }
}

// The messages of a bag of ROS 2.
template <typename Writer>
void write_topics(const FaultyDive& dive, Writer& bag) {
  const auto put = [](CdrBytes& bytes, const std::vector<double>& v, std::size_t from,
                      std::size_t count) {
    for (std::size_t i = from; i < from + count; ++i) bytes.put(v[i]);
  };
  add_topic(bag, dive.imu, "/imu/data", "sensor_msgs/msg/Imu", 6,
            [&](CdrBytes& bytes, const auto& v) {
              bytes.zeros(3).put(1.0).zeros(9);
              put(bytes, v, 0, 3);
              bytes.zeros(9);
              put(bytes, v, 3, 3);
              bytes.zeros(9);
            });
  add_topic(bag, dive.dvl, "/dvl/twist", "geometry_msgs/msg/TwistWithCovarianceStamped", 3,
            [&](CdrBytes& bytes, const auto& v) {
              put(bytes, v, 0, 3);
              bytes.zeros(3 + 36);
            });
  add_topic(bag, dive.depth, "/depth", "nav_msgs/msg/Odometry", 1,
            [&](CdrBytes& bytes, const auto& v) {
              bytes.text("child").zeros(2).put(-v[0]).zeros(3).put(1.0).zeros(36 + 6 + 36);
            });
  add_topic(bag, dive.truth, "/gt", "nav_msgs/msg/Odometry", 7,
            [&](CdrBytes& bytes, const auto& v) {
              bytes.text("child");
              put(bytes, v, 0, 3);
              put(bytes, v, 4, 3);  // x y z w, from w x y z
              bytes.put(v[3]).zeros(36 + 6 + 36);
            });
}

}  // namespace

FaultTable FaultTable::read(const std::filesystem::path& file) {
  std::ifstream in(file);
  FaultTable table;
  std::string line;
  std::getline(in, line);
  table.header = split(line);
  while (std::getline(in, line)) table.rows.push_back(split(line));
  return table;
}

void FaultTable::write(const std::filesystem::path& file) const {
  std::ofstream out(file, std::ios::binary);
  out << prefix;
  const auto put = [&](const std::vector<std::string>& cells) {
    for (std::size_t i = 0; i < cells.size(); ++i) {
      if (i > 0) out << separator;
      out << cells[i];
    }
    out << line_end;
  };
  put(header);
  for (const auto& row : rows) put(row);
}

void FaultyDive::write_folder(const std::filesystem::path& folder) const {
  const std::filesystem::path mav = folder / "mav0";
  imu.write(mav / "imu0/data.csv");
  dvl.write(mav / "dvl0/data.csv");
  depth.write(mav / "depth0/data.csv");
  truth.write(mav / "state_groundtruth_estimate0/data.csv");
}

void FaultyDive::write_mcap(const std::filesystem::path& file) const {
  McapWriter mcap;
  write_topics(*this, mcap);
  std::ofstream(file, std::ios::binary) << mcap.finish();
}

void FaultyDive::write_db3(const std::filesystem::path& file) const {
  std::filesystem::remove(file);
  Db3Writer db3(file);
  write_topics(*this, db3);
  db3.close();
}

void FaultTable::scale(std::size_t column, double factor) {
  for (auto& row : rows) {
    if (column >= row.size() ||
        row[column].find_first_not_of("0123456789.e+-") < row[column].size())
      continue;
    if (!row[column].empty()) row[column] = fmt::format("{:.9g}", factor * std::stod(row[column]));
  }
}

std::int64_t FaultTable::stamp(std::size_t row) const {
  const double seconds =
      rows[row][0].find('.') == std::string::npos ? 0.0 : std::stod(rows[row][0]);
  return seconds > 0.0 ? static_cast<std::int64_t>(seconds * 1e9) : std::stoll(rows[row][0]);
}

std::vector<Fault> bag_faults() {
  const std::set<std::string> of_text = {"unknown unit", "stamps in seconds",
                                         "microseconds called nanoseconds"};
  std::vector<Fault> faults = all_faults();
  std::erase_if(faults, [&](const Fault& f) { return f.is_harmless || of_text.contains(f.name); });
  return faults;
}

std::vector<Fault> all_faults() {
  std::vector<Fault> all = harmless_faults();
  for (auto* more : {value_faults, time_faults}) {
    for (Fault& fault : more()) all.push_back(std::move(fault));
  }
  return all;
}

}  // namespace apvi::test
