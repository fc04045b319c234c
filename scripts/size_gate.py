#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Fails when a function is longer than 80 lines or a file longer than 500, or when most are too long.

Nine of ten files of C++ and CUDA have at most 222 lines, and nine of ten functions at most 20.
Uses a brace matcher, accurate to one or two lines. --report also prints the distribution of lengths.
"""
import argparse
import pathlib
import re
import subprocess
import sys

MAX_FUNCTION, MAX_FILE = 80, 500
MAX_P90_FUNCTION, MAX_P90_FILE = 20, 222
CODE = (".hpp", ".cpp", ".cu", ".cuh")
OTHERS = (".py", ".sh", ".cmake")
# Preprocessor lines, comments and literals, whose braces must be ignored.
NOISE = re.compile(
    r"^[ \t]*#(?:[^\n]*\\\n)*[^\n]*"
    r"|//[^\n]*|/\*.*?\*/"
    r'|R"(?P<tag>\w*)\(.*?\)(?P=tag)"|"(?:\\.|[^"\\\n])*"'
    r"|(?<!\w)'(?:\\.|[^'\\\n])+'",
    re.DOTALL | re.MULTILINE)
NO_FUNCTION = re.compile(
    r"\b(namespace|class|struct|union|enum|if|for|while|switch|catch|do|else|try)\b[^()]*(\(|$)")
# Matches `Type(int a) : member_{`: the brace opens a member initializer, not the body.
INITIALIZER = re.compile(r"\)\s*(noexcept\s*)?:([^:].*)?[\w>]\s*$", re.DOTALL)


def without_noise(text):
    """The text with directives, comments and literals blanked, line breaks kept."""
    return NOISE.sub(lambda match: re.sub(r"[^\n]", " ", match.group()), text)


def closing_brace(text, opening):
    depth = 0
    for i in range(opening, len(text)):
        depth += {"{": 1, "}": -1}.get(text[i], 0)
        if depth == 0:
            return i
    return len(text) - 1


def is_function(head):
    return ")" in head and not NO_FUNCTION.match(head.strip()) and not re.search(r"=\s*$", head)


def functions(text):
    """Yields (first line, name, lines) of every function with a body, including nested lambdas."""
    text = without_noise(text)
    start = i = 0
    while i < len(text):
        c = text[i]
        if c in ";}":
            start = i + 1
        elif c == "{":
            head = text[start:i]
            if INITIALIZER.search(head):  # a member's initializer before the body
                i = closing_brace(text, i)
            elif is_function(head):
                begin = start + len(head) - len(head.lstrip())
                end = closing_brace(text, i)
                name = re.search(r"([\w:~]+)[^\w\s]*\s*\(", head)
                first = text.count("\n", 0, begin) + 1
                yield first, name.group(1) if name else "?", text.count("\n", begin, end) + 1
                i, start = end, end + 1
            else:
                start = i + 1
        i += 1


def our_files(root):
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=root, check=True, capture_output=True, text=True)
    names = [name for name in listed.stdout.split("\n") if name.endswith(CODE + OTHERS)]
    return [root / name for name in names if (root / name).is_file()]


def p90(values):
    """The length that nine of ten do not exceed; 0 for none."""
    return sorted(values)[int(0.9 * len(values))] if values else 0


def summary(name, values):
    values = sorted(values)
    if values:
        print(f"{name}: {len(values)}, lines median {values[len(values) // 2]}, "
              f"90 % {p90(values)}, longest {values[-1]}")


def problems_of_p90(file_lines, function_lines):
    for name, values, limit in (("files", file_lines, MAX_P90_FILE),
                                ("functions", function_lines, MAX_P90_FUNCTION)):
        if p90(values) > limit:
            yield f"one in ten {name} has {p90(values)} lines or more, {limit} are allowed: split the longest"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--report", action="store_true", help="print the distribution of lengths")
    options = parser.parse_args()
    root = pathlib.Path(__file__).resolve().parent.parent
    too_long, file_lines, function_lines = [], [], []
    for path in our_files(root):
        text = path.read_text(encoding="utf-8")
        name, lines = path.relative_to(root), text.count("\n")
        if lines > MAX_FILE:
            too_long.append(f"{name}: the file has {lines} lines, {MAX_FILE} are allowed")
        if path.suffix in CODE:
            found = list(functions(text))
            too_long += [f"{name}:{line}: {function} has {n} lines, {MAX_FUNCTION} are allowed"
                         for line, function, n in found if n > MAX_FUNCTION]
            file_lines.append(lines)
            function_lines += [n for _, _, n in found if n > 1]
    if options.report:
        summary("files", file_lines)
        summary("functions of two lines or more", function_lines)
    too_long += problems_of_p90(file_lines, function_lines)
    print("\n".join(too_long) or "size gate: no function above 80 lines, no file above 500")
    return 1 if too_long else 0


if __name__ == "__main__":
    sys.exit(main())
