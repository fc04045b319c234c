#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs clang-tidy on changed sources, on all sources, or on the given files.

Changes are relative to the merge base with origin/main, or to the last 8 commits if there is none, and
include uncommitted ones. A changed header selects the source of the same name.
"""
import argparse
import concurrent.futures
import json
import os
import pathlib
import subprocess
import sys
import time

import check_layers

ROOT = pathlib.Path(__file__).resolve().parent.parent
BUILD = ROOT / "build" / "tidy"
COMMITS = 8
# Sources here need C++20. Those that include LibTorch too are skipped: clang 14 parses its headers as C++17 only.
NEED_CPP20 = ("src/slam/", "tests/slam/", "src/survey/", "tests/survey/", "src/runs/", "tests/runs/", "src/cli/")


def git(*arguments):
    done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True)
    return done.stdout.split() if done.returncode == 0 else []


def base_commit():
    head, base = git("rev-parse", "HEAD"), git("merge-base", "HEAD", "origin/main")
    if not base or base == head:
        base = git("rev-list", f"--max-count={COMMITS + 1}", "HEAD")[-1:]
    return base[0]


def changed_files():
    return git("diff", "--name-only", base_commit()) + git("ls-files", "--others", "--exclude-standard")


def readable(name):
    """Whether clang-tidy 14 can parse the source."""
    return not name.startswith(NEED_CPP20) or not check_layers.torch_chain(name)


def sources_for(names):
    """Compiled sources that correspond to the given sources and headers."""
    compiled = {os.path.relpath(entry["file"], ROOT)
                for entry in json.loads((BUILD / "compile_commands.json").read_text())}
    stems = {pathlib.PurePath(name).stem for name in names if name.endswith(".hpp")}
    return sorted(name for name in compiled if name.endswith(".cpp")
                  and (name in names or pathlib.PurePath(name).stem in stems) and readable(name))


def tidy(name, deadline):
    """(name, output, whether it is clean, or None if skipped for lack of time)."""
    if time.monotonic() > deadline:
        return name, "", None
    done = subprocess.run(["clang-tidy", "-p", str(BUILD), "--quiet", name], cwd=ROOT,
                          capture_output=True, text=True)
    return name, done.stdout if done.returncode == 0 else done.stdout + done.stderr, done.returncode == 0


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("files", nargs="*", help="files to check instead of the changed ones")
    parser.add_argument("--all", action="store_true", help="every source")
    parser.add_argument("--changed", action="store_true", help="only print the names of the changed files")
    parser.add_argument("--seconds", type=float, default=600.0, help="start no further file after this time")
    parser.add_argument("-j", "--jobs", type=int, default=len(os.sched_getaffinity(0)))
    options = parser.parse_args()
    if options.changed:
        print(*changed_files(), sep="\n")
        return 0
    subprocess.run(["cmake", "--preset", "tidy", "--log-level=WARNING"], cwd=ROOT, check=True,
                   stdout=subprocess.DEVNULL)
    names = options.files or (git("ls-files") if options.all else changed_files())
    sources = sources_for({os.path.relpath(name) for name in names})
    deadline = time.monotonic() + options.seconds
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        results = list(pool.map(lambda name: tidy(name, deadline), sources))
    for _, output, _ in results:
        print(output, end="" if not output or output.endswith("\n") else "\n")
    with_findings = [name for name, _, clean in results if clean is False]
    skipped = sum(clean is None for _, _, clean in results)
    print(f"tidy: {len(sources)} sources, {skipped} skipped for lack of time, "
          f"{len(with_findings)} with findings", *with_findings, sep="\n  ")
    return 1 if with_findings else 0


if __name__ == "__main__":
    sys.exit(main())
