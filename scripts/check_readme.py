#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Fails when a command in a code block of README.md or docs/ names what is not there.

Looked at: scripts and configuration files of this tree, presets of CMake, subcommands of apvi (when it
is built), and relative links.
"""
import json
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
APVI = ROOT / "build" / "cpu" / "src" / "apps" / "apvi"
OUR_FILE = re.compile(r"(?<![\w/.-])((?:scripts|configs|\.ci|docs|tests)/[\w./-]*\w)")


def code_lines(text):
    """(line number, line) of fenced code blocks that are shell."""
    inside = False
    for number, line in enumerate(text.split("\n"), start=1):
        fence = re.match(r"\s*```\s*(\w*)", line)
        if fence:
            inside = not inside and fence.group(1) in ("", "sh", "bash", "console", "shell")
        elif inside:
            yield number, line


def subcommands():
    """Those `apvi --help` lists, or None when there is no program to ask."""
    if not APVI.exists():
        return None
    text = subprocess.run([APVI, "--help"], capture_output=True, text=True, check=False).stdout
    return set(re.findall(r"^  ([a-z]+) ", text.partition("Subcommands:")[2], re.MULTILINE))


def complaints_about(line, presets, known):
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
            yield f"the link {link} leads nowhere"


def main():
    presets = {preset["name"] for preset in
               json.loads((ROOT / "CMakePresets.json").read_text())["configurePresets"]}
    known = subcommands()
    found = 0
    for path in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        if not path.exists():
            continue
        text, name = path.read_text(encoding="utf-8"), path.relative_to(ROOT)
        messages = [f"{name}:{number}: {what}" for number, line in code_lines(text)
                    for what in complaints_about(line, presets, known)]
        messages += [f"{name}: {what}" for what in broken_links(path, text)]
        found += len(messages)
        print("\n".join(messages), end="\n" if messages else "")
    print(f"readme: {found} complaints")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
