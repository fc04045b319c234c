#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Tests of scripts/report.py and scripts/explain_run.py on a small synthetic run."""
import base64
import importlib.util
import json
import math
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

SCRIPTS = pathlib.Path(__file__).resolve().parents[2] / "scripts"
NEEDED = ("jinja2", "matplotlib", "numpy")
MISSING = [name for name in NEEDED if not importlib.util.find_spec(name)]
SKIPPED = 77  # exit status that ctest treats as "skipped"

TRACKS = ("trajectory.tum", "trajectory_smoothed.tum", "vio.tum", "dipo.tum")
START_NS = 1_700_000_000_000_000_000
CALIBRATION_HEADER = (
    "#timestamp [ns],dvl_time_offset [s],dvl_time_offset_sigma [s],dvl_scale_error,"
    "dvl_scale_error_sigma,mounting_x [rad],mounting_y [rad],mounting_z [rad],mounting_sigma [rad],"
    "lever_x [m],lever_y [m],lever_z [m],lever_sigma [m],depth_bias [m],depth_bias_sigma [m],"
    "gyro_bias_x [rad s^-1],gyro_bias_y [rad s^-1],gyro_bias_z [rad s^-1],gyro_bias_sigma [rad s^-1],"
    "accel_bias_x [m s^-2],accel_bias_y [m s^-2],accel_bias_z [m s^-2],accel_bias_sigma [m s^-2]")
HEALTH_HEADER = (
    "#timestamp [ns],verdict,nis,degrees_of_freedom,accel_noise_factor,dvl_variance_factor,"
    "position_sigma [m],rotation_sigma [deg],velocity_sigma [m s^-1]")
REFERENCE_HEADER = "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w,q_x,q_y,q_z"


def poses(count=60):
    """(stamp [ns], x, y, z, yaw) on a spiral; z is down."""
    for i in range(count):
        angle = 0.1 * i
        yield (START_NS + i * 1_000_000_000, 5.0 * math.cos(angle), 8.0 * math.sin(angle),
               2.0 + 0.02 * i, angle)


def tum_lines():
    return "".join(f"{ns // 10**9}.{ns % 10**9:09d} {x:.6f} {y:.6f} {z:.6f} 0 0 "
                   f"{math.sin(yaw / 2):.9f} {math.cos(yaw / 2):.9f}\n"
                   for ns, x, y, z, yaw in poses())


def calibration_lines():
    return CALIBRATION_HEADER + "\n" + "".join(
        f"{ns},0.1,0.01,0,0,0,0,0.7854,0,-1.84,-0.04,0.11,0,0.02,0.01,1e-3,2e-3,3e-3,1e-4,"
        "0.1,0.2,0.3,0.02\n" for ns, *_ in poses())


def ping_lines():
    rows = [f"{ns},{'rejected,90.0' if i == 30 else 'accepted,2.5'},3,10,1,0.1,0.5,0.02\n"
            for i, (ns, *_) in enumerate(poses())]
    rows[0] = f"{START_NS},no_lock,0,0,10,1,0.1,0.5,0.02\n"
    return HEALTH_HEADER + "\n" + "".join(rows)


def reference_lines():
    """The same path, rotated by 90 degrees about the vertical and shifted."""
    rows = []
    for ns, x, y, z, yaw in poses():
        half = yaw / 2 + math.pi / 4
        rows.append(f"{ns},{-y + 100:.6f},{x - 50:.6f},{z + 7:.6f},"
                    f"{math.cos(half):.9f},0,0,{math.sin(half):.9f}\n")
    return REFERENCE_HEADER + "\n" + "".join(rows)


def gnss_lines():
    """The same path as GNSS fixes: east is y, north is x."""
    return "#timestamp [ns],east [m],north [m],up [m]\n" + "".join(
        f"{ns},{y + 10:.6f},{x + 20:.6f},0\n" for ns, x, y, *_ in poses())


FRAME_HEADER = (
    "#timestamp [ns],state,level,reason,measured,threshold,vio,tracked,detected,stable,landmarks,"
    "rotation_eigenvalue_1 [rad^-2],rotation_eigenvalue_2 [rad^-2],rotation_eigenvalue_3 [rad^-2],"
    "position_eigenvalue_1 [m^-2],position_eigenvalue_2 [m^-2],position_eigenvalue_3 [m^-2]")


def frame_lines():
    """Ten frames per second; vision fails in the middle third."""
    rows = []
    for i in range(590):
        dark = 200 <= i < 400
        rows.append(f"{START_NS + i * 100_000_000},"
                    + ("frozen,coarse,too_few_features,3,50,tracking,3,0,0,9,9e5,1e6,2e6,50,60,70"
                       if dark else
                       "fused,accepted,none,0,0,tracking,120,5,90,100,4e6,5e6,9e6,400,500,900"))
    return FRAME_HEADER + "\n" + "\n".join(rows) + "\n"


def timing_lines():
    return "#timestamp [ns],decode [s],track [s],solve [s],information [s],marginalize [s],localize [s],dropped\n" + \
        "".join(f"{START_NS + i * 100_000_000},0.001,0.00{1 + i % 4},0.002,0.0001,0.0002,0.0001,0\n"
                for i in range(590))


def write_image(path, color, size=(80, 60)):
    from PIL import Image  # pylint: disable=import-outside-toplevel
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.stem.endswith("_depth"):
        Image.effect_mandelbrot(size, (-2, -1.5, 1, 1.5), 100).point(lambda v: 8 * v + 500, "I").save(path)
    else:
        Image.new("RGB", size, color).save(path)


METRICS = {
    "trajectory": {"ate_rmse_m": 1.2345, "coverage": 0.5, "matched": 60,
                   "dipo": {"ate_rmse_m": 1.2345, "coverage": 0.5, "matched": 60}},
    "counts": {"dvl": {"accepted": 58, "rejected": 1, "no_lock": 1}, "imu_gaps": 3,
               "dropped_samples": {"imu": 4}},
    "speed": {"wall_s": 0.5, "sequence_s": 60.0, "realtime_factor": 120.0},
    "build": {"backend": "cpu", "git": "0123456789ab"}}


class RunFolder:
    """A run and its recording in a temporary folder."""

    def __init__(self):
        self.temporary = tempfile.TemporaryDirectory()
        root = pathlib.Path(self.temporary.name)
        self.run, self.dataset = root / "run", root / "pool <1>"
        self.run.mkdir()
        self.dataset.mkdir()
        for name, text in (*((track, tum_lines()) for track in TRACKS),
                           ("calibration.csv", calibration_lines()), ("pings.csv", ping_lines()),
                           ("metrics.json", json.dumps(METRICS)),
                           ("log.txt", "a line of the log\n"), ("resolved.yaml", self.resolved())):
            self.write(self.run / name, text)
        self.write(self.sensor("state_groundtruth_estimate0"), reference_lines())
        self.write(self.sensor("imu0"), "#timestamp [ns],w_x\n" + "".join(
            f"{ns},0\n" for ns, *_ in poses()))

    def resolved(self):
        return (f"dataset:\n  path: {self.dataset}\n  format: auto\n"
                "rig:\n  body: imu0\n  world: ned\neval:\n  align: se3\n  max_gap_s: 2\n")

    def sensor(self, name):
        return self.dataset / "mav0" / name / "data.csv"

    @staticmethod
    def write(path, text):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def report(*arguments):
    return subprocess.run([sys.executable, SCRIPTS / "report.py", *arguments], capture_output=True,
                          text=True, check=False)


def plots_in(html):
    found = re.findall(r' src="data:image/svg\+xml;base64,([^"]+)"', html)
    return [base64.b64decode(data).decode() for data in found]


def add_camera_and_map(folder):
    """Adds the files of a run with vision and a map."""
    folder.write(folder.run / "health.csv", frame_lines())
    folder.write(folder.run / "timing.csv", timing_lines())
    water = ("beta_d_r [m^-1],beta_d_g [m^-1],beta_d_b [m^-1],beta_b_r [m^-1],beta_b_g [m^-1],"
             "beta_b_b [m^-1],b_inf_r,b_inf_g,b_inf_b")
    folder.write(folder.run / "mapping.csv",
                 f"#time [s],iteration,gaussians,psnr_heldout [dB],{water}\n" + "".join(
                     f"{i},{10 * i},{1000 * i},{20 + i},.3,.1,.1,.2,.1,.1,.0,.1,.{i}\n" for i in range(1, 4)))
    folder.write(folder.run / "medium.json", json.dumps(
        {"beta_d": [0.3, 0.1, 0.1], "beta_b": [0.2, 0.1, 0.1], "b_inf": [0.0, 0.1, 0.2]}))
    for i in range(9):
        for kind, color in (("truth", "teal"), ("render", "green"), ("restored", "olive"), ("depth", None)):
            write_image(folder.run / "renders" / f"{START_NS + i}_{kind}.png", color)
    folder.write(folder.run / "renders" / "views.csv",
                 "#image,psnr_db,psnr_median_image_db,depth_rmse_m,restored_psnr_db\n" + "".join(
                     f"{START_NS + i * 10**9},{25 + i},20,{'' if i % 2 else 0.1},\n" for i in range(9)))
    write_image(folder.dataset / "truth" / "clear" / f"{START_NS}.png", "khaki")


class Case(unittest.TestCase):
    def setUp(self):
        self.folder = RunFolder()
        self.addCleanup(self.folder.temporary.cleanup)

    def make(self):
        """Returns the report page of `folder`."""
        from report import page, run_data  # pylint: disable=import-outside-toplevel
        return page.render(run_data.load(self.folder.run))

    def keep_only_poses(self):  # for speed
        for name in (*TRACKS[1:], "calibration.csv", "pings.csv", "metrics.json", "log.txt", "resolved.yaml"):
            (self.folder.run / name).unlink()

    def assert_sections(self, html, *titles):
        self.assertEqual(re.findall("<h2>(.*?)</h2>", html), list(titles))

    def assert_has(self, html, pattern):
        """Like assertRegex, without printing the page."""
        self.assertTrue(re.search(pattern, html), f"nothing matches {pattern}")


class WholeRun(Case):
    """A complete run without camera; all tests share one page."""
    html = None

    def make(self):
        if WholeRun.html is None:
            WholeRun.html = super().make()
        return WholeRun.html

    def test_has_every_section(self):
        html = self.make()
        self.assert_sections(html, "Trajectory", "Error over time", "Consistency", "Calibration",
                             "Sensors", "Metrics", "Configuration")
        self.assertEqual(len(plots_in(html)), 7)
        self.assert_has(html, "a line of the log")

    def test_page_loads_no_external_resources(self):
        html = self.make()
        for text in [html, *plots_in(html)]:
            text = re.sub(r'xmlns(:xlink)?="[^"]*"', "", text)
            found = re.findall(r'https?://\S*|@import|(?:href|src)="(?!#|data:)[^"]*', text)
            self.assertEqual(found, [])

    def test_escapes_names(self):
        self.assert_has(self.make(), "<h1>pool &lt;1&gt;</h1>")

    def test_metrics_have_names_and_units(self):
        html = self.make()
        row = r'<td>{}</td><td class="n">{}</td><td class="u">{}</td>'
        for name, value, unit in (("Absolute position error, RMSE", "1.234", "m"),
                                  ("Coverage of the reference", "50.0", "%"),
                                  ("Gaps in the IMU data", "3", ""),
                                  ("Revision", "0123456789ab", "")):
            self.assert_has(html, row.format(name, re.escape(value), unit))
        self.assert_has(html, r'DVL pings, accepted</td><td class="n">58</td>'
                              r'<td class="n">96\.7</td>')
        self.assert_has(html, r'Dropped before use, IMU</td><td class="n">4</td>')

    def test_lists_states_that_were_not_estimated(self):
        self.assert_has(self.make(), r"Not estimated: DVL scale error 0 %; DVL mounting "
                        r"\(0, 0, 45\) °; DVL lever arm \(-184, -4, 11\) cm\.")

    def test_reports_fractions_of_nis_inside_the_band(self):
        self.assert_has(self.make(), "98 % lie inside the 95 % band, 2 % above it, 0 % below")


class PartialRun(Case):
    def test_unknown_metric_is_shown_by_its_key_and_warnings_come_first(self):
        self.keep_only_poses()
        self.folder.write(self.folder.run / "metrics.json", '{"warnings": ["cam0: 9 of 9"], "vio": {"new_figure": 7}}')
        self.assert_has(self.make(), r'<td>vio\.new_figure</td><td class="n">7</td>')
        self.assert_has(self.make(), r'<main>\s*<section[^>]*>\s*<h2>Warnings</h2>\s*<ul>\s*<li>cam0: 9 of 9</li>')

    def test_optional_files_may_be_missing(self):
        self.keep_only_poses()
        self.assert_sections(self.make(), "Trajectory", "Metrics", "Configuration")

    def test_run_without_poses_has_a_note(self):
        self.folder.write(self.folder.run / "trajectory.tum", "")
        html = self.make()
        self.assert_has(html, "fewer than two poses")
        self.assert_sections(html, "Trajectory", "Metrics", "Configuration")

    def test_ignores_incomplete_last_line_of_killed_run(self):
        for name in ("trajectory.tum", "pings.csv", "calibration.csv"):
            with open(self.folder.run / name, "a", encoding="utf-8") as file:
                file.write("17000000")
        self.assertEqual(len(plots_in(self.make())), 7)

    def test_recording_of_another_format_has_a_note(self):
        text = self.folder.resolved().replace(str(self.folder.dataset), "/somewhere/else.bag")
        self.folder.write(self.folder.run / "resolved.yaml", text)
        html = self.make()
        self.assert_has(html, "No reference: the recording was not found")
        self.assert_sections(html, "Trajectory", "Consistency", "Calibration", "Sensors", "Metrics",
                             "Configuration")

    def test_shows_renders_without_camera_images(self):
        self.keep_only_poses()
        for i in range(30):
            write_image(self.folder.run / "renders" / f"{i:06d}_render.png", "green")
        html = self.make()
        self.assertEqual(html.count('src="data:image/jpeg;base64,'), 6)
        self.assert_has(html, "6 of 30 views")
        self.assert_sections(html, "Trajectory", "Map", "Metrics", "Configuration")


class RunWithAMap(Case):
    html = None

    def make(self):
        if RunWithAMap.html is None:
            add_camera_and_map(self.folder)
            RunWithAMap.html = super().make()
        return RunWithAMap.html

    def test_has_vision_and_map_sections(self):
        html = self.make()
        self.assert_sections(html, "Trajectory", "Map", "Error over time", "Vision", "Water",
                             "Consistency", "Calibration", "Sensors", "Computing time", "Metrics",
                             "Configuration")
        self.assertEqual(len(plots_in(html)), 13)

    def test_every_plot_has_a_phone_version(self):
        html = self.make()
        self.assertEqual(len(re.findall(r'srcset="data:image/svg\+xml', html)), 13)

    def test_view_panels_contain_metrics_of_held_out_views(self):
        from report import map_figures, run_data  # pylint: disable=import-outside-toplevel
        add_camera_and_map(self.folder)
        shown = map_figures.view_panels(run_data.load(self.folder.run))
        third = {title: curves[0][0][2] for title, curves in shown}
        self.assertEqual(third, {"PSNR [dB]": 27.0, "depth, RMSE [m]": 0.1})

    def test_views_have_comparison_sliders(self):
        html = self.make()
        self.assertEqual(html.count('type="range"'), 12)
        self.assertEqual(html.count("truth without water"), 2)  # alt text and tag of one image
        self.assert_has(html, r"depth, 0\.5 to \d\.\d m")

    def test_counts_reasons_of_the_discriminator(self):
        self.assert_has(self.make(), r'<td>too few features</td><td class="n">200 of 590</td>')

    def test_page_loads_no_external_resources(self):
        text = self.make()
        found = re.findall(r'https?://\S*|@import|(?:href|src|srcset)="(?!#|data:)[^"]*', text)
        self.assertEqual(found, [])


class SweepFolder(Case):
    SUMMARY = ("group,seed,state,reason,case,dataset.path,trajectory.ate_rmse_m\n"
               "full_a,1,done,,full,data/a,0.1\nfull_a,2,done,,full,data/a,0.3\n"
               "full_b,1,done,,full,data/b,0.5\nfull_b,2,open,,full,data/b,\n"
               "blind_a,1,done,,blind,data/a,0.4\nblind_a,2,done,,blind,data/a,0.6\n"
               'blind_b,1,failed,"exit status 2: a, <b>",blind,data/b,\n'
               "blind_b,2,failed,killed by signal 9,blind,data/b,\n")

    def make_sweep(self):
        folder = self.folder.run.parent / "sweep"
        self.folder.write(folder / "summary.csv", self.SUMMARY)
        self.folder.write(folder / "summary.md", "| case | dataset.path | finished | "
                          "trajectory.ate_rmse_m | speed.wall_s |\n|---|---|---|---|---|\n")
        result = report(folder)
        self.assertEqual(result.returncode, 0, result.stderr)
        return (folder / "report.html").read_text(encoding="utf-8")

    def test_table_has_cases_as_rows_and_sequences_as_columns(self):
        html = self.make_sweep()
        self.assert_sections(html, r"Absolute position error, RMSE [m]", "Failures")
        self.assert_has(html, r'<tr><th>case</th><th class="n">a</th><th class="n">b</th></tr>')
        self.assert_has(html, r'<td>full</td><td class="n best">0\.2 ± 0\.14 <small>2/2</small></td>'
                              r'<td class="n">0\.5 <small>1/2</small></td>')
        self.assert_has(html, r'<td>blind</td><td class="n">0\.5 ± 0\.14 <small>2/2</small></td>'
                              r'<td class="n">failed <small>0/2</small></td>')
        self.assertEqual(len(plots_in(html)), 1)

    def test_failures_have_reasons(self):
        html = self.make_sweep()
        self.assert_has(html, r'<td>blind_b</td><td class="n">1</td><td>exit status 2: a, &lt;b&gt;</td>')
        self.assert_has(html, r"<b>2<small></small></b><span>failed</span>")
        self.assert_has(html, r"<b>1<small></small></b><span>not started or interrupted</span>")

    def test_incomplete_sweep_folder_is_an_input_error(self):
        folder = self.folder.run.parent / "half"
        self.folder.write(folder / "summary.csv", self.SUMMARY)
        result = report(folder)
        self.assertEqual(result.returncode, 2)
        self.assertIn("summary.md: missing or empty", result.stderr)


class Program(Case):
    def test_folder_without_run_is_an_input_error(self):
        for folder in (self.folder.dataset, self.folder.run / "nowhere"):
            result = report(folder)
            self.assertEqual(result.returncode, 2)
            self.assertTrue(result.stderr.startswith(f"report.py: {folder}: no "), result.stderr)
            self.assertEqual(result.stderr.count("\n"), 1)

    def test_error_names_file_and_line(self):
        path = self.folder.run / "pings.csv"
        lines = ping_lines().split("\n")
        lines[4] = "1,accepted"
        self.folder.write(path, "\n".join(lines))
        result = report(self.folder.run)
        self.assertEqual(result.returncode, 2)
        self.assertIn("pings.csv:5: 2 columns, but the header has 9", result.stderr)

    def test_output_option_sets_the_file(self):
        self.keep_only_poses()
        page = self.folder.dataset / "a.html"
        self.assertEqual(report(self.folder.run, "-o", page).returncode, 0)
        self.assertTrue(page.is_file())
        self.assertFalse((self.folder.run / "report.html").exists())

    def test_fails_when_the_page_cannot_be_written(self):
        self.keep_only_poses()
        result = report(self.folder.run, "-o", self.folder.run / "none" / "a.html")
        self.assertEqual(result.returncode, 1)
        self.assertIn("cannot write this file", result.stderr)


class ExplainRun(Case):
    def explain(self, folder):
        return subprocess.run([sys.executable, SCRIPTS / "explain_run.py", folder], capture_output=True,
                              text=True, check=False)

    def test_prints_metrics_with_explanations(self):
        metrics = {"trajectory": {"ate_rmse_m": 0.0123, "path_length_m": 40.0, "coverage": 0.5,
                                  "ate_percent_of_path": 0.03075},
                   "vio": {"failures": 2, "reinit_times_s": [0.2, 0.7]},
                   "mapping": {"psnr_db": 28.0, "psnr_median_image_db": 20.0, "heldout_views": 9,
                               "gaussians": 25000}}
        self.folder.write(self.folder.run / "metrics.json", json.dumps(metrics))
        result = self.explain(self.folder.run)
        self.assertEqual(result.returncode, 0, result.stderr)
        for text in ("0.012 m  position error", "40.0 m of path", "50 %  of the reference",
                     "2  vision failures, recovered at most 0.7 s", "28.0 dB  PSNR of 9 held-out views",
                     "baseline: 20.0 dB", "25,000  Gaussians"):
            self.assertIn(text, result.stdout)

    def test_folder_without_metrics_is_an_input_error(self):
        result = self.explain(self.folder.dataset)
        self.assertEqual(result.returncode, 2)
        self.assertIn("metrics.json", result.stderr)


class Alignment(Case):
    def compare(self):
        from report import alignment, run_data  # pylint: disable=import-outside-toplevel
        return alignment.compare(run_data.load(self.folder.run))

    def test_transformed_reference_gives_zero_error(self):
        comparison = self.compare()
        self.assertEqual(len(comparison.t), 60)
        self.assertLess(comparison.rmse, 1e-5)
        self.assertLess(comparison.rotation.max(), 1e-4)

    def test_gnss_matches_a_north_east_down_estimate(self):
        self.folder.sensor("state_groundtruth_estimate0").unlink()
        self.folder.write(self.folder.sensor("gnss0"), gnss_lines())
        comparison = self.compare()
        self.assertEqual(comparison.axes, 2)
        self.assertIsNone(comparison.rotation)
        self.assertLess(comparison.rmse, 1e-5)

    def test_error_includes_heights_unless_reference_is_planar(self):
        rows = reference_lines().split("\n")
        for i in range(1, 61, 2):
            cells = rows[i].split(",")
            cells[3] = str(float(cells[3]) + 1.0)
            rows[i] = ",".join(cells)
        self.folder.write(self.folder.sensor("state_groundtruth_estimate0"), "\n".join(rows))
        self.assertAlmostEqual(self.compare().rmse, 0.5, delta=0.01)

    def test_disjoint_time_spans_are_not_compared(self):
        rows = [f"{int(row.split(',')[0]) + 10**12},{row.split(',', 1)[1]}"
                for row in reference_lines().split("\n")[1:-1]]
        self.folder.write(self.folder.sensor("state_groundtruth_estimate0"),
                          "\n".join([REFERENCE_HEADER, *rows, ""]))
        self.assertIsNone(self.compare())

    def test_slerp_interpolates_at_constant_rate(self):
        import numpy as np  # pylint: disable=import-outside-toplevel
        from report import alignment  # pylint: disable=import-outside-toplevel
        axis = np.array([[2.0, -1.0, 2.0]]) / 3.0
        first = alignment.rotations_about(np.array([[0.0, 0.6, 0.8]]), np.array([0.7]))
        last = first @ alignment.rotations_about(axis, np.array([1.2]))
        middle = first @ alignment.rotations_about(axis, np.array([0.3]))
        found = alignment.slerp(first, last, np.array([0.25]))
        np.testing.assert_allclose(found, middle, atol=1e-12)
        np.testing.assert_allclose(alignment.angles(middle @ np.swapaxes(first, 1, 2)), [0.3])


class ChiSquare(unittest.TestCase):
    def test_quantiles_match_tables(self):
        from report import sensor_figures  # pylint: disable=import-outside-toplevel
        table = {1: (0.000982, 5.0239), 2: (0.050636, 7.3778), 3: (0.215795, 9.3484),
                 4: (0.484419, 11.1433), 30: (16.7908, 46.9792)}
        for degrees, bounds in table.items():
            for probability, value in zip((0.025, 0.975), bounds):
                found = sensor_figures.chi_square_quantile(probability, degrees)
                self.assertAlmostEqual(found, value, delta=1e-4)


class Packages(unittest.TestCase):
    def test_missing_packages_are_named(self):
        result = subprocess.run([sys.executable, "-S", "-I", SCRIPTS / "report.py", "run"],
                                capture_output=True, text=True, check=False)
        self.assertEqual(result.returncode, 1)
        self.assertIn("apt install python3-jinja2 python3-matplotlib python3-numpy", result.stderr)


if __name__ == "__main__":
    if MISSING:
        print(f"skipped: apt install {' '.join('python3-' + name for name in MISSING)}")
        sys.exit(SKIPPED)
    sys.path.insert(0, str(SCRIPTS))
    unittest.main()
