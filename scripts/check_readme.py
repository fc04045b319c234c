#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Fails when a code block or link in README.md, CONTRIBUTING.md or docs/ refers to something that does not exist.

Checks scripts and configuration files of this repository, CMake presets, subcommands of apvi (if it is
built), relative links, the version in CITATION.cff and CHANGELOG.md, and the lengths of README.md and of
docs/decisions.
"""
import json
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
README_LINES = 149
DECISIONS = 10
APVI = ROOT / "build" / "cpu" / "bin" / "apvi"
OUR_FILE = re.compile(r"(?<![\w/.-])((?:scripts|configs|examples|\.ci|docs|tests)/[\w./-]*\w)")


def code_lines(text):
    """(line number, line) of fenced shell code blocks."""
    inside = shell = False
    for number, line in enumerate(text.split("\n"), start=1):
        fence = re.match(r"\s*```\s*(\w*)", line)
        if fence:
            inside = not inside
            shell = inside and fence.group(1) in ("", "sh", "bash", "console", "shell")
        elif shell:
            yield number, line


def subcommands():
    """Subcommands listed by `apvi --help`, or None if apvi is not built."""
    if not APVI.exists():
        return None
    text = subprocess.run([APVI, "--help"], capture_output=True, text=True, check=False).stdout
    return set(re.findall(r"^  ([a-z]+) ", text.partition("Subcommands:")[2], re.MULTILINE))


def problems_in(line, presets, known):
    for name in OUR_FILE.findall(line):
        if not (ROOT / name).exists():
            yield f"{name} does not exist"
    for preset in re.findall(r"--preset[ =](\w+)", line):
        if preset not in presets:
            yield f"CMakePresets.json has no preset {preset}"
    for command in re.findall(r"(?:^|[\s/])apvi ([a-z]+)\b", line):
        if known is not None and command not in known:
            yield f"apvi has no command {command}"


def broken_links(path, text):
    for link in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
        if not (path.parent / link).exists():
            yield f"broken link {link}"


def version_problems():
    """CITATION.cff and CHANGELOG.md must know the version of CMakeLists.txt."""
    version = re.search(r"project\(apvi VERSION ([\d.]+)", (ROOT / "CMakeLists.txt").read_text()).group(1)
    for name, line in (("CITATION.cff", f"^version: {re.escape(version)}$"),
                       ("CHANGELOG.md", f"^## \\[{re.escape(version)}\\]")):
        if not re.search(line, (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE):
            yield f"{name}: version {version} of CMakeLists.txt is missing"


def size_problems():
    """Messages about documents that grew beyond what a reader takes in."""
    lines = len((ROOT / "README.md").read_text(encoding="utf-8").splitlines())
    if lines > README_LINES:
        yield f"README.md: {lines} lines, at most {README_LINES} allowed"
    decisions = len(list((ROOT / "docs" / "decisions").glob("*.md")))
    if decisions > DECISIONS:
        yield f"docs/decisions: {decisions} pages, at most {DECISIONS} allowed"


def main():
    presets = {preset["name"] for preset in
               json.loads((ROOT / "CMakePresets.json").read_text())["configurePresets"]}
    known = subcommands()
    messages = [*version_problems(), *size_problems()]
    for path in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        text, name = path.read_text(encoding="utf-8"), path.relative_to(ROOT)
        messages += [f"{name}:{number}: {what}" for number, line in code_lines(text)
                     for what in problems_in(line, presets, known)]
        messages += [f"{name}: {what}" for what in broken_links(path, text)]
    print("\n".join([*messages, f"readme: {len(messages)} problems"]))
    return 1 if messages else 0


if __name__ == "__main__":
    sys.exit(main())
