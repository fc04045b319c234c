#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""`apvi sweep --launcher slurm` on a cluster of one machine: slurm_sweep_test.py APVI.
Skips with the reason when Slurm is not installed or does not start."""
import csv
import pathlib
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import slurm_cluster

SKIPPED = 77
ROOT = pathlib.Path(__file__).resolve().parents[2]
APVI = sys.argv.pop(1) if len(sys.argv) > 1 else str(ROOT / "build/cpu/bin/apvi")
PATIENCE_S = 90.0
COLUMNS = "columns: [trajectory.ate_rmse_m, trajectory.coverage]\n"
cluster = None  # shared by all tests, started once


def until(condition, what):
    end = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > end:
            raise AssertionError(f"timed out waiting for {what}")
        time.sleep(0.05)


class SlurmSweep(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.temporary.name)
        cls.dive = cls.folder / "dive with a 'quote'"
        cls.simulate(cls.dive, 15)

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    @staticmethod
    def simulate(folder, seconds):
        subprocess.run([APVI, "sim", ROOT / "configs/scenes/seabed_easy.yaml", "-o", folder, "--no-images",
                        "--set", f"duration_s={seconds}"], check=True, capture_output=True)

    def setUp(self):
        self.out = self.folder / self.id().rpartition(".")[2]

    def sweep_file(self, text, dive=None):
        base = self.folder / "base.yaml"
        base.write_text(f'dataset: {{path: "{dive or self.dive}"}}\n', encoding="utf-8")
        path = self.folder / f"{self.out.name}.yaml"
        path.write_text("base: base.yaml\n" + text, encoding="utf-8")
        return path

    def command(self, file, *more, out=None):
        return [APVI, "sweep", file, "-o", out or self.out, *more]

    def sweep(self, file, *more, out=None):
        return subprocess.run(self.command(file, *more, out=out), env=cluster.environment, text=True,
                              capture_output=True, timeout=900, check=False)

    def on_slurm(self, file, *more):
        return self.sweep(file, "--launcher", "slurm", *more)

    def begin(self, file, *more):
        log = open(self.folder / f"{self.out.name}.log", "w", encoding="utf-8")  # pylint: disable=consider-using-with
        with log:
            return subprocess.Popen(self.command(file, "--launcher", "slurm", *more),  # pylint: disable=consider-using-with
                                    env=cluster.environment, stdout=log, stderr=log)

    def rows(self):
        with open(self.out / "summary.csv", encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))

    def under_way(self):
        return cluster.ask("squeue", "--me", "--noheader", "--array", "--format=%F_%K").stdout.split()

    def finished(self):
        """Case -> modification time of its metrics."""
        return {path: (self.out / path.relative_to(self.out / "cases").with_suffix("") / "metrics.json")
                .stat().st_mtime_ns for path in (self.out / "cases").rglob("*.done")}

    def test_table_equals_local_table(self):
        file = self.sweep_file("cases: {both: {}, without depth: {sensors.use: [imu, dvl]}}\nseeds: 2\n" + COLUMNS)
        result = self.on_slurm(file)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("4 cases submitted as Slurm job array", result.stderr)
        self.assertEqual({row["state"] for row in self.rows()}, {"done"})
        local = self.sweep(file, out=self.folder / "local")
        self.assertEqual(local.returncode, 0, local.stderr)
        self.assertEqual(result.stdout, local.stdout)
        again = self.on_slurm(file)
        self.assertIn("4 cases, 4 already finished", again.stderr)
        self.assertNotIn("submitted", again.stderr)

    def test_launchers_share_finished_cases(self):
        file = self.sweep_file("seeds: 2\n" + COLUMNS)
        self.assertEqual(self.sweep(file).returncode, 0)
        self.assertIn("2 cases, 2 already finished", self.on_slurm(file).stderr)

    def test_failed_case_is_reported_and_retried(self):
        gone = self.folder / "gone"
        file = self.sweep_file(f"cases: {{good: {{}}, gone: {{dataset.path: {gone}}}}}\n" + COLUMNS)
        result = self.on_slurm(file)
        self.assertEqual(result.returncode, 1)
        self.assertIn("1 of 2 cases failed", result.stderr)
        good, bad = self.rows()
        self.assertEqual(good["state"], "done")
        self.assertEqual(bad["state"], "failed")
        self.assertRegex(bad["reason"], "^exit status 2: .*gone")
        self.simulate(gone, 15)
        again = self.on_slurm(file)
        self.assertEqual(again.returncode, 0, again.stderr)
        self.assertIn("1 cases submitted", again.stderr)

    def test_canceled_case_reports_slurm_state(self):
        file = self.sweep_file("seeds: [1]\n" + COLUMNS)
        # It never runs, so only Slurm knows its state.
        child = self.begin(file, "--sbatch=--begin=now+1hour")
        until(self.under_way, "the job")
        self.assertEqual(cluster.ask("scancel", *self.under_way()).returncode, 0)
        self.assertEqual(child.wait(PATIENCE_S), 1)
        self.assertRegex(self.rows()[0]["reason"], r"^Slurm job \d+_0: CANCELLED, without an exit status$")

    def test_ctrl_c_cancels_jobs_and_command_resumes(self):
        self.simulate(self.folder / "long dive", 200)
        file = self.sweep_file("seeds: 6\n" + COLUMNS, self.folder / "long dive")
        child = self.begin(file, "-j", "1")
        until(lambda: (self.out / "summary.csv").exists() and "done" in [r["state"] for r in self.rows()], "a case")
        child.send_signal(signal.SIGINT)
        self.assertEqual(child.wait(PATIENCE_S), 1)
        until(lambda: not self.under_way(), "an empty queue")
        before = self.finished()
        self.assertGreaterEqual(len(before), 1)
        self.assertLess(len(before), 6)
        rest = self.on_slurm(file)
        self.assertEqual(rest.returncode, 0, rest.stderr)
        self.assertIn(f"6 cases, {len(before)} already finished", rest.stderr)
        after = self.finished()
        self.assertEqual(len(after), 6)
        self.assertEqual({path: after[path] for path in before}, before)

    def test_array_outlives_command_and_is_found_again(self):
        file = self.sweep_file("seeds: 3\n" + COLUMNS)
        child = self.begin(file, "-j", "1", "--sbatch=--begin=now+5")
        until(lambda: (self.out / "cases/" / f"{self.out.name}" / "seed-3.slurm").exists(), "the array")
        child.kill()
        child.wait()
        self.assertEqual(len(self.under_way()), 3)
        result = self.on_slurm(file)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertNotIn("submitted", result.stderr)
        self.assertIn("active as Slurm job", result.stderr)
        self.assertEqual([row["state"] for row in self.rows()], ["done"] * 3)

    def test_rejects_other_settings_while_jobs_are_active(self):
        file = self.sweep_file("seeds: [1]\n" + COLUMNS)
        child = self.begin(file, "--sbatch=--begin=now+1hour")
        until(self.under_way, "the job")
        until(lambda: list(self.out.rglob("*.slurm")), "the element's name")
        child.kill()
        child.wait()
        other = self.sweep_file("seeds: [1]\nset: {localization.gravity: 9.81}\n" + COLUMNS)
        result = self.on_slurm(other)
        self.assertEqual(result.returncode, 1)
        self.assertRegex(result.stderr, r"active as Slurm job \d+_0 with other settings")
        cluster.ask("scancel", "--me")

    def test_reports_missing_slurm(self):
        file = self.sweep_file("seeds: [1]\n" + COLUMNS)
        result = subprocess.run(self.command(file, "--launcher", "slurm"), env={"PATH": str(self.folder)},
                                text=True, capture_output=True, check=False)
        self.assertEqual(result.returncode, 2)
        self.assertIn("squeue not found; install slurm-client", result.stderr)

    def test_rejects_sbatch_options_without_slurm(self):
        result = self.sweep(self.sweep_file("seeds: [1]\n"), "--sbatch=--time=1")
        self.assertEqual(result.returncode, 2)
        self.assertIn("--sbatch", result.stderr)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="slurm") as place:
        try:
            with slurm_cluster.Cluster(pathlib.Path(place) / "cluster") as cluster:
                ended = unittest.main(exit=False)
        except slurm_cluster.Unavailable as reason:
            print(f"skipped: {reason}")
            sys.exit(SKIPPED)
    sys.exit(0 if ended.result.wasSuccessful() else 1)
