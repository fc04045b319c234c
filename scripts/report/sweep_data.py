# SPDX-License-Identifier: BSD-3-Clause
"""Reads the output of `apvi sweep`: summary.csv, and the table layout from summary.md."""
import csv
import dataclasses
import math
import pathlib
import re

from .run_data import InputError, read_text

FIXED = ("group", "seed", "state", "reason")
# Metrics for which higher or lower is better; for others no best value is marked.
HIGHER = re.compile(r"psnr|ssim|coverage|fps|success|realtime_factor|iterations_per_s")
LOWER = re.compile(r"rmse|ate_|rpe_|rot_|lpips|abs_rel|error_percent|failures|reinit|wall_s|mib")


@dataclasses.dataclass
class Case:
    """One line of summary.csv."""
    group: str
    seed: str
    state: str   # done, failed, open
    reason: str
    choices: tuple
    metrics: dict


@dataclasses.dataclass
class Statistic:
    """Statistic of a metric over the seeds of a group; mean is None when no finished case has it."""
    values: list
    finished: int
    failed: int
    total: int

    @property
    def mean(self):
        return math.fsum(self.values) / len(self.values) if self.values else None

    @property
    def spread(self):
        """Sample standard deviation; None for fewer than two values."""
        if len(self.values) < 2:
            return None
        squares = math.fsum((value - self.mean)**2 for value in self.values)
        return math.sqrt(squares / (len(self.values) - 1))

    def text(self):
        """As in summary.md: "0.0171 ± 0.0012 (2)" if only two of the finished cases have it."""
        if not self.values:
            return "failed" if self.failed == self.total > 0 else "–"
        text = f"{self.mean:.4g}"
        if self.spread is not None:
            text += f" ± {self.spread:.2g}"
        return text + (f" ({len(self.values)})" if len(self.values) < self.finished else "")


@dataclasses.dataclass
class Sweep:
    folder: pathlib.Path
    axes: list       # names
    columns: list    # metrics of the table
    cases: list

    @property
    def name(self):
        return self.folder.resolve().name

    def count(self, state):
        return sum(case.state == state for case in self.cases)

    def alternatives(self, axis):
        """Values of an axis in sweep order."""
        return list(dict.fromkeys(case.choices[axis] for case in self.cases))

    def statistic(self, choices, column):
        """Statistic over the seeds of the cases with these choices (None matches any)."""
        some = [case for case in self.cases
                if all(want in (None, have) for want, have in zip(choices, case.choices))]
        done = [case for case in some if case.state == "done"]
        return Statistic([case.metrics[column] for case in done if column in case.metrics],
                         len(done), sum(case.state == "failed" for case in some), len(some))


def table_header(path):
    """(axes, columns) of summary.md: the columns before and after "finished"."""
    lines = read_text(path).splitlines()
    if not lines:
        raise InputError(f"{path}: missing or empty; expected a folder written by `apvi sweep`")
    cells = [cell.strip().replace("\\|", "|") for cell in re.split(r"(?<!\\)\|", lines[0])[1:-1]]
    if "finished" not in cells:
        raise InputError(f"{path}:1: not a sweep table: no column \"finished\"")
    at = cells.index("finished")
    return cells[:at], cells[at + 1:]


def number(cell):
    try:
        value = float(cell)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def read_case(row, axes):
    """The table of a sweep without axes has one axis "sweep"; its value is the group."""
    choices = tuple(row.get(axis, row["group"]) for axis in axes)
    metrics = {name: number(cell) for name, cell in row.items()
               if name not in FIXED and name not in axes and cell}
    return Case(row["group"], row["seed"], row["state"], row["reason"], choices,
                {name: value for name, value in metrics.items() if value is not None})


def load(folder):
    """Raises InputError if the folder is not a sweep folder."""
    axes, columns = table_header(folder / "summary.md")
    path = folder / "summary.csv"
    rows = list(csv.DictReader(read_text(path).splitlines()))
    if not rows or any(name not in rows[0] for name in FIXED):
        raise InputError(f"{path}: not a sweep summary; expected the columns {','.join(FIXED)}")
    return Sweep(folder, axes, columns, [read_case(row, axes) for row in rows])


def is_sweep(folder):
    return (folder / "summary.csv").is_file()


def better(column):
    """max or min by which direction is better; None if undefined."""
    if HIGHER.search(column):
        return max
    return min if LOWER.search(column) else None
