#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Fails when a line of a document is longer than 100 characters, except in tables and code, and links alone."""
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
MAX_LENGTH = 100
LINK = re.compile(r"\s*([-*] )?!?\[[^]]*\]\([^)]*\)[.,;:]?")


def long_lines(text):
    """Yields (number, length) of the lines that are too long."""
    in_code = False
    for number, line in enumerate(text.split("\n"), 1):
        if line.lstrip().startswith("```"):
            in_code = not in_code
        elif not in_code and len(line) > MAX_LENGTH and not line.lstrip().startswith("|") and not LINK.fullmatch(line):
            yield number, len(line)


def main():
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.md"]
    listed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    names = [name for name in listed.stdout.split("\n") if name and (ROOT / name).is_file()]
    problems = [f"{name}:{number}: {length} characters"
                for name in names for number, length in long_lines((ROOT / name).read_text(encoding="utf-8"))]
    print("\n".join(problems) or f"prose: no line above {MAX_LENGTH} characters")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
