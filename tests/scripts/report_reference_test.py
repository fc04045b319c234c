#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Tests of the report with a damaged reference, which is optional."""
import sys
import unittest

import report_test


class DamagedReference(report_test.Case):
    def compare(self):
        from report import alignment, run_data  # pylint: disable=import-outside-toplevel
        return alignment.compare(run_data.load(self.folder.run))

    def test_bad_rows_of_the_reference_are_left_out(self):
        rows = report_test.reference_lines().split("\n")
        stamp = rows[20].split(",")[0]
        rows[20] = stamp + ",nan" * 7
        rows[21] = rows[21].split(",")[0] + "," * 7
        rows[30], rows[31] = rows[31], rows[30]
        rows.insert(40, rows[40])
        self.folder.write(self.folder.sensor("state_groundtruth_estimate0"), "\n".join(rows))
        self.assertLess(self.compare().rmse, 1e-2)

    def test_reference_without_a_good_row_is_left_out(self):
        for bad in ("1,nan,nan,nan,nan,nan,nan,nan\n", "1,a,b,c,d,e,f,g\n", "1,2\n"):
            self.folder.write(self.folder.sensor("state_groundtruth_estimate0"),
                              report_test.REFERENCE_HEADER + "\n" + bad)
            self.assertIsNone(self.compare(), bad)


if __name__ == "__main__":
    if report_test.MISSING:
        print(f"skipped: apt install {' '.join('python3-' + name for name in report_test.MISSING)}")
        sys.exit(report_test.SKIPPED)
    sys.path.insert(0, str(report_test.SCRIPTS))
    unittest.main()
