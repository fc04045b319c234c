#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Makes the man page of apvi out of what `apvi --help` and `apvi COMMAND --help` print.

    scripts/man_page.py PROGRAM OUTPUT.1.gz
"""
import gzip
import pathlib
import re
import subprocess
import sys

ENTRY = re.compile(r"  (\S.*?)(?:\s{2,}(\S.*))?")
CONTINUED = re.compile(r"\s{20,}(\S.*)")
HEADING = re.compile(r"(\S.*):")
USAGE = re.compile(r"Usage: (.*)")


def help_text(program, command):
    result = subprocess.run([program, *command, "--help"], check=True, capture_output=True, text=True)
    return [line.rstrip() for line in result.stdout.split("\n")]


def subcommands(lines):
    """Names below the heading `Subcommands:`."""
    if "Subcommands:" not in lines:
        return []
    below = lines[lines.index("Subcommands:") + 1:]
    return [match[1] for match in map(ENTRY.fullmatch, below) if match]


def escaped(text):
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return "\\&" + text if text.startswith((".", "'")) else text


def roff(line):
    """Lines of the man page for a line of help."""
    if not line:
        return []
    if match := CONTINUED.fullmatch(line):
        return [escaped(match[1])]
    if match := ENTRY.fullmatch(line):
        return [".TP", f".B {escaped(match[1])}"] + ([escaped(match[2])] if match[2] else [])
    if match := USAGE.fullmatch(line):
        return [".PP", f".B {escaped(match[1])}"]
    if match := HEADING.fullmatch(line):
        return [".PP", f"{escaped(match[1])}:"]
    return [".PP", escaped(line)]


def command_pages(program, command, lines):
    """The sections of the subcommands of a command, and of theirs."""
    page = []
    for name in subcommands(lines):
        inner = [*command, name]
        text = help_text(program, inner)
        page += [f".SS apvi {' '.join(inner)}", *(row for line in text for row in roff(line))]
        page += command_pages(program, inner, text)
    return page


def man_page(program):
    version = subprocess.run([program, "--version"], check=True, capture_output=True, text=True).stdout
    lines = help_text(program, [])
    usage = next(match[1] for match in map(USAGE.fullmatch, lines) if match)
    options = lines[lines.index("Options:") + 1:lines.index("Subcommands:")]
    page = [f'.TH APVI 1 "" "{version.splitlines()[0]}" "User Commands"',
            ".SH NAME", f"apvi \\- {escaped(lines[0])}",
            ".SH SYNOPSIS", f".B {escaped(usage)}",
            ".SH OPTIONS", *(row for line in options for row in roff(line)),
            ".SH COMMANDS", *command_pages(program, [], lines)]
    return "\n".join(page) + "\n"


def main():
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    program, output = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    content = man_page(program).encode()
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_bytes(gzip.compress(content, mtime=0))
    return 0


if __name__ == "__main__":
    sys.exit(main())
