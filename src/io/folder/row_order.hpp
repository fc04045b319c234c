// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

namespace apvi::io {

/// The time of a row and a hash of its text.
struct TimedRow {
  double time_s = 0.0;  ///< NaN without a stamp: the row stays behind the one before it
  std::size_t content = 0;
};

struct RowOrder {
  std::vector<std::size_t> rows;  ///< by time; empty when the order of the file counts
  std::size_t late = 0;           ///< rows that are earlier than the row before them
};

/// Tells rows that were mixed up, such as those of a merged file, from a clock that was set back.
///
/// Mixed rows fall between the others. After a clock was set back, the same times come again with
/// other values, or times long before the first ones; the order of the file counts then. Rows with
/// a stray stamp stay where they are. Fewer than 20 rows tell nothing.
RowOrder order_by_time(const std::vector<TimedRow>& rows);

}  // namespace apvi::io
