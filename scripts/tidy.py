#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs clang-tidy on the sources that changed, on all of them, or on the files given.

What changed: since this branch left origin/main, or, where it did not, in the last 8 commits; and what
is not committed yet. A changed header stands for the source of the same name.
"""
import argparse
import concurrent.futures
import json
import os
import pathlib
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
BUILD = ROOT / "build" / "tidy"
COMMITS = 8
# These need C++20 and see LibTorch, whose headers clang 14 reads as C++17 only.
UNREADABLE = ("src/bridge/", "tests/bridge/", "src/apps/render.cpp", "src/apps/export.cpp")


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


def sources_for(names):
    """Sources that the build compiles, for sources and headers."""
    compiled = {os.path.relpath(entry["file"], ROOT)
                for entry in json.loads((BUILD / "compile_commands.json").read_text())}
    stems = {pathlib.PurePath(name).stem for name in names if name.endswith(".hpp")}
    return sorted(name for name in compiled if name.endswith(".cpp") and not name.startswith(UNREADABLE)
                  and (name in names or pathlib.PurePath(name).stem in stems))


def tidy(name, deadline):
    """(name, what to print, whether it is clean: None when there was no time)."""
    if time.monotonic() > deadline:
        return name, "", None
    done = subprocess.run(["clang-tidy", "-p", str(BUILD), "--quiet", name], cwd=ROOT,
                          capture_output=True, text=True)
    return name, done.stdout if done.returncode == 0 else done.stdout + done.stderr, done.returncode == 0


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("files", nargs="*", help="instead of what changed")
    parser.add_argument("--all", action="store_true", help="every source")
    parser.add_argument("--changed", action="store_true", help="print the names of what changed, do nothing else")
    parser.add_argument("--seconds", type=float, default=600.0, help="start no further file after that")
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
    dirty = [name for name, _, clean in results if clean is False]
    unseen = sum(clean is None for _, _, clean in results)
    print(f"tidy: {len(sources)} sources, {unseen} of them not looked at for want of time, "
          f"{len(dirty)} with findings", *dirty, sep="\n  ")
    return 1 if dirty else 0


if __name__ == "__main__":
    sys.exit(main())
