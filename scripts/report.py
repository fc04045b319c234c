#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Creates a self-contained report.html from the folder of a run, a sweep or a change map.

    scripts/report.py RUN [-o report.html]

All figures and images are embedded in the page. Sections without data are omitted.
"""
import argparse
import importlib.util
import pathlib
import sys

PACKAGES = {name: f"python3-{name}" for name in ("jinja2", "matplotlib", "numpy")}


def missing_packages():
    """Required Debian packages that are not installed."""
    return [package for module, package in PACKAGES.items() if not importlib.util.find_spec(module)]


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("run", type=pathlib.Path, metavar="RUN", help="output folder of `apvi run`, `apvi sweep` or `apvi diff`")
    parser.add_argument("-o", "--output", type=pathlib.Path, metavar="FILE",
                        help="output file (default: RUN/report.html)")
    return parser.parse_args()


def fail(message, status):
    print(f"report.py: {message}", file=sys.stderr)
    return status


def main():
    arguments = parse_arguments()
    missing = missing_packages()
    if missing:
        return fail(f"missing packages: apt install {' '.join(missing)} (for /usr/bin/python3; this is "
                    f"{sys.executable})", 1)
    from report import change_data, change_page, page, run_data, sweep_data, sweep_page, template  # pylint: disable=import-outside-toplevel
    output = arguments.output or arguments.run / "report.html"
    try:
        if sweep_data.is_sweep(arguments.run):
            text = sweep_page.render(sweep_data.load(arguments.run))
        elif change_data.is_change_map(arguments.run):
            text = change_page.render(change_data.load(arguments.run))
        else:
            text = page.render(run_data.load(arguments.run))
    except run_data.InputError as error:
        return fail(error, 2)
    try:
        template.write(text, output)
    except OSError as error:
        return fail(f"{output}: cannot write this file: {error.strerror}", 1)
    print(output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
