// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "io/dataset_builder.hpp"

namespace apvi {
namespace {

using io::DropReason;
using test::config_for;
using test::input_error;
using test::read_dataset;
using test::TmpDir;
using testing::HasSubstr;

constexpr std::int64_t kStart = 1'403'636'581'838'555'574;

// Three rows of an IMU in this dialect, which must mean the same.
void expect_same_samples(const std::string& text) {
  const TmpDir dir;
  test::write_imu(dir, text);
  const auto out = read_dataset(config_for(dir.path()));
  ASSERT_EQ(out.events.size(), 2U) << text;
  EXPECT_EQ(out.dropped("imu"), 0U) << text;
  EXPECT_EQ(stamp_of(out.events[0]).ns, kStart) << text;
  EXPECT_EQ(stamp_of(out.events[1]).ns, kStart + 5'000'000) << text;
  EXPECT_EQ(std::get<ImuSample>(out.events[1]).gyro, Eigen::Vector3d(0.1, -0.25, 3)) << text;
  EXPECT_EQ(std::get<ImuSample>(out.events[1]).accel, Eigen::Vector3d(1, 0.002, 9.5)) << text;
}

TEST(CsvDialects, MeanTheSame) {
  const std::string header = "#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z\n";
  const std::string first = "1403636581838555574";
  const std::string second = "1403636581843555574";
  const std::string row = ",0.1,-0.25,3,1,2e-3,9.5\n";
  expect_same_samples(header + first + row + second + row);
  expect_same_samples(header + first + ".0" + row + second + ".0" + row);
  expect_same_samples(header + "1.403636581838555574e18" + row + "1.403636581843555574E+18" + row);
  expect_same_samples("time [s],w_x,w_y,w_z,a_x,a_y,a_z\n1403636581.838555574" + row +
                      "1403636581.843555574" + row);
  expect_same_samples("time,w_x,w_y,w_z,a_x,a_y,a_z\n1403636581.838555574" + row +
                      "1403636581.843555574" + row);
  const std::string quoted =
      "\"#timestamp [ns]\",\"w_x\",\"w_y\",\"w_z\",\"a_x\",\"a_y\",\"a_z\"\n";
  expect_same_samples(quoted + "\"" + first + "\",\"0.1\",-0.25,3,1,2e-3,9.5\n" + second + row);
  const std::string commas = ";0,1;-0,25;3;1;2e-3;9,5;\r\n";
  expect_same_samples("\xEF\xBB\xBF#timestamp [ns];w_x;w_y;w_z;a_x;a_y;a_z;\r\n" + first + commas +
                      second + commas);
  const std::string tabs = "\t0.1\t-0.25\t3\t1\t2e-3\t9.5\n";
  expect_same_samples("timestamp\tw_x\tw_y\tw_z\ta_x\ta_y\ta_z\n" + first + tabs + second + tabs);
  expect_same_samples(
      "timestamp,angular_velocity_x,angular_velocity_y,angular_velocity_z,linear_acceleration_x,"
      "linear_acceleration_y,linear_acceleration_z\n" +
      first + row + second + row);
  std::string rostopic = "%time";  // of `rostopic echo -p`
  for (const char* vector : {"angular_velocity", "linear_acceleration"}) {
    for (const char c : {'x', 'y', 'z'}) rostopic += fmt::format(",field.{}.{}", vector, c);
  }
  expect_same_samples(rostopic + "\n" + first + row + second + row);
  expect_same_samples(
      "time (ns),Gyro X (rad/s),Gyro Y (rad/s),Gyro Z (rad/s),Acc X (m/s^2),Acc Y (m/s^2),"
      "Acc Z (m/s^2)\n" +
      first + row + second + row);
}

TEST(CsvDialects, MissingColumnsAreNamedWithThoseThatThereAre) {
  const TmpDir dir;
  test::write_imu(dir, "t,p,q,r,a_x,a_y,a_z\n1,2,3,4,5,6,7\n");
  EXPECT_THAT(input_error([&] { read_dataset(config_for(dir.path())); }),
              HasSubstr("no column \"w_x\"; add it, or rename the one that holds it; there are t, "
                        "p, q, r, a_x, a_y, a_z"));
}

TEST(CsvDialects, StampsThatLostDigitsAreAnError) {
  const TmpDir dir;
  std::string text = "#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z\n";
  for (int i = 0; i < 50; ++i) text += fmt::format("1.40364E+18,{},0,0,0,0,9.8\n", 0.001 * i);
  test::write_imu(dir, text);
  EXPECT_THAT(input_error([&] { read_dataset(config_for(dir.path())); }),
              HasSubstr("such as 1.40364E+18: the stamps lost digits"));
}

TEST(CsvDialects, RepeatedRowsAreDuplicates) {
  const TmpDir dir;
  std::string text = "#timestamp [ns],depth [m]\n";
  for (int i = 0; i < 100; ++i) text += fmt::format("{},{}\n", 1000 + i / 10, i / 10);
  dir.write("mav0/depth0/data.csv", text);
  EXPECT_EQ(read_dataset(config_for(dir.path())).delivered("depth"), 10U);
}

TEST(CsvDialects, Utf16IsAnErrorThatSaysSo) {
  const TmpDir dir;
  test::write_imu(dir, std::string("\xFF\xFE#\0t\0", 6));
  EXPECT_THAT(input_error([&] { read_dataset(config_for(dir.path())); }), HasSubstr("UTF-16"));
}

TEST(CsvDialects, TimeIsFoundByTheNameOfItsColumn) {
  const std::string first = "1403636581838555574";
  const std::string second = "1403636581843555574";
  const std::string row = "0.1,-0.25,3,1,2e-3,9.5";
  expect_same_samples("w_x,w_y,w_z,a_x,a_y,a_z,timestamp [ns]\n" + row + "," + first + "\n" + row +
                      "," + second + "\n");
  expect_same_samples("seq,timestamp,w_x,w_y,w_z,a_x,a_y,a_z\n0," + first + "," + row + "\n1," +
                      second + "," + row + "\n");
  expect_same_samples(",time_us,w_x,w_y,w_z,a_x,a_y,a_z\n0,1403636581838555.574," + row +
                      "\n1,1403636581843555.574," + row + "\n");
  expect_same_samples("ros_time [ns],w_x,w_y,w_z,a_x,a_y,a_z,t\n" + first + "," + row + ",0\n" +
                      second + "," + row + ",5\n");
}

TEST(CsvDialects, RemarksMayPrecedeTheHeader) {
  const std::string rows =
      "1403636581838555574;0.1;-0.25;3;1;2e-3;9.5\n1403636581843555574;0.1;-0.25;3;1;2e-3;9.5\n";
  expect_same_samples(
      "# time of export, version 2\n# second line\n\n"
      "#timestamp [ns];w_x;w_y;w_z;a_x;a_y;a_z\n" +
      rows);
  expect_same_samples("sep=;\ntimestamp;w_x;w_y;w_z;a_x;a_y;a_z\n" + rows);
}

TEST(CsvDialects, BarsSeparate) {
  expect_same_samples(
      "timestamp|w_x|w_y|w_z|a_x|a_y|a_z\n1403636581838555574|0.1|-0.25|3|1|2e-3|9.5\n"
      "1403636581843555574|0.1|-0.25|3|1|2e-3|9.5\n");
}

std::string error_of(const std::string& text) {
  const TmpDir dir;
  test::write_imu(dir, text);
  return input_error([&] { read_dataset(config_for(dir.path())); });
}

// 50 rows of an IMU whose times are these.
template <typename Time>
std::string rows_at(const std::string& time_column, Time&& time) {
  std::string text = time_column + ",w_x,w_y,w_z,a_x,a_y,a_z\n";
  for (int i = 0; i < 50; ++i) text += time(i) + ",0,0,0,0,0,9.8\n";
  return text;
}

TEST(CsvDialects, OtherTablesAreErrorsThatSayWhatTheyAre) {
  EXPECT_THAT(error_of("timestamp w_x w_y w_z a_x a_y a_z\n1 0 0 0 0 0 9.8\n"),
              HasSubstr("data.csv:1: one column only; separate them by commas"));
  EXPECT_THAT(error_of("#timestamp,w_x\r1,0\r2,0\r"), HasSubstr("the lines end in CR only"));
  EXPECT_THAT(error_of(std::string("t\0i\0m\0e\0", 8)), HasSubstr("this file is UTF-16"));
  EXPECT_THAT(error_of(std::string(100, '\0')), HasSubstr("zero bytes instead of a header line"));
}

TEST(CsvDialects, TimesThatAreNoNanosecondsAreErrors) {
  EXPECT_THAT(error_of(rows_at("time", [](int i) { return fmt::format("{}", 10 * i); })),
              HasSubstr("column time has no unit and steps by 10, too little for nanoseconds; name "
                        "the unit in the header, such as time [ms]"));
  EXPECT_THAT(
      error_of(rows_at("time [ns]", [](int i) { return fmt::format("1457229350.{:02}", i + 1); })),
      HasSubstr("nanoseconds have no decimals, but 1457229350.01 has: is it [s]?"));
}

TEST(CsvDialects, DatesAreTimes) {
  const std::string row = ",0.1,-0.25,3,1,2e-3,9.5\n";
  const std::string names = ",w_x,w_y,w_z,a_x,a_y,a_z\n";
  expect_same_samples("time" + names + "2014-06-24T19:03:01.838555574Z" + row +
                      "2014-06-24T19:03:01.843555574Z" + row);
  expect_same_samples("UTC [ISO]" + names + "2014-06-24 21:03:01.838555574+02:00" + row +
                      "2014-06-24 21:03:01.843555574+02:00" + row);
  expect_same_samples("Date,Time" + names + "2014-06-24,19:03:01.838555574" + row +
                      "2014-06-24,19:03:01.843555574" + row);
}

TEST(CsvDialects, DatesThatCannotBeReadAreErrors) {
  const auto with = [](const char* before) {
    return error_of(
        rows_at("time", [=](int i) { return fmt::format("{}12:00:{:02}", before, i); }));
  };
  EXPECT_THAT(with("01.05.2024 "), HasSubstr("a date whose day and month may be confused"));
  EXPECT_THAT(with("5/1/2024 "), HasSubstr("a date whose day and month may be confused"));
  EXPECT_THAT(with(""), HasSubstr("a time of day without a date; add a column date"));
  EXPECT_THAT(with("2024-May-01 "), HasSubstr("no date and time as 2024-05-01T12:00:00Z"));
}

TEST(CsvDialects, AHeaderWithinIsSkippedIfItIsTheSame) {
  const std::string header = "timestamp,w_x,w_y,w_z,a_x,a_y,a_z\n";
  const std::string row = ",0.1,-0.25,3,1,2e-3,9.5\n";
  expect_same_samples(header + "1403636581838555574" + row + header + "1403636581843555574" + row);
  EXPECT_THAT(error_of(header + "1403636581838555574" + row +
                       "timestamp,a_x,a_y,a_z,w_x,w_y,w_z\n1403636581843555574" + row),
              HasSubstr("data.csv:3: another header, with columns in another order or unit"));
}

TEST(CsvDialects, ZeroBytesAtTheEndAreOneBadRow) {
  const TmpDir dir;
  test::write_imu(
      dir, std::string(test::kImuHeader) + test::imu_rows({1.0, 1.1}) + std::string(5000, '\0'));
  testing::internal::CaptureStderr();
  const auto out = read_dataset(config_for(dir.path()));
  EXPECT_EQ(testing::internal::GetCapturedStderr().find('\0'), std::string::npos);
  EXPECT_EQ(out.delivered("imu"), 2U);
  EXPECT_EQ(out.dropped("imu", DropReason::malformed), 1U);
}

TEST(MalformedRows, AreReportedOncePerKindWithTextAndCount) {
  const TmpDir dir;
  test::write_imu(dir, std::string(test::kImuHeader) + test::imu_rows({1.0}) +
                           "1100000000,0,0,0,bad,0,0\n1200000000,0,0,0,worse,0,0\n"
                           "hello,0,0,0,0,0,0\n1300000000,0,0\n");
  testing::internal::CaptureStderr();
  const auto out = read_dataset(config_for(dir.path()));
  const std::string log = testing::internal::GetCapturedStderr();
  EXPECT_EQ(out.dropped("imu", DropReason::malformed), 4U);
  EXPECT_THAT(log, HasSubstr("data.csv:3: imu sample dropped: malformed: column a_x is not a "
                             "number: \"bad\""));
  EXPECT_THAT(log, testing::Not(HasSubstr("worse")));
  EXPECT_THAT(log, HasSubstr("imu: 2 samples dropped: column a_x is not a number"));
  EXPECT_THAT(log, HasSubstr("no stamp in the first column: \"hello\""));
  EXPECT_THAT(log, HasSubstr("too few cells: \"1300000000,0,0\""));
}

}  // namespace
}  // namespace apvi
