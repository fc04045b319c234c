#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Fails on misspelled words and on words that are not this project's: see docs/glossary.md.

    scripts/check_language.py [FILE...]      without files: every text file that git does not ignore

codespell checks the spelling (American); correct words that it rejects are in scripts/codespell_words.txt.
PHRASES are searched for inside identifiers too.
"""
import argparse
import fnmatch
import pathlib
import re
import shutil
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
WORDS = ROOT / "scripts" / "codespell_words.txt"

# (what must not be written, what to write instead); lower-case letters match both cases.
PHRASES = [
    # British spelling, which codespell finds in whole words only
    (r"colour|neighbour|behaviour|favour", "American spelling: -or"),
    (r"centre|metres?(?![a-z])", "American spelling: -er"),
    (r"[a-z]{3,}isations?(?![a-z])", "American spelling: -ization"),
    (r"(normal|initial|marginal|regular|optim|linear|synchron|discret|recogn|local|visual|serial|parallel"
     r"|quant|general|minim|maxim|summar|vector|raster|stabil|util|factor)is(e[drs]?|ing|able)(?![a-z])",
     "American spelling: -ize"),
    (r"(mode|labe|trave|signa|cance)ll(ed|ing)(?![a-z])", "American spelling: a single l"),
    (r"(?<![a-z])(grey|analogue|catalogue|programme|whilst|licence|artefact|learnt|spelt)(?![a-z])",
     "American spelling"),
    # words of this project's past
    (r"(?<![a-z])pictures?(?![a-z])", "image, render"),
    (r"\bk(most|least|fewest)\w*", "kMax..., kMin..."),
    (r"sightings?", "observation"),
    (r"murk", "low visibility"),
    (r"(?<![a-z])(un)?veil(s|ed)?(?![a-z])", "veiling light, backscatter"),
    (r"(?<![a-z])haze(?![a-z])", "backscatter"),
    (r"(?<![a-z])glow(s|ing)?(?![a-z])", "lamp backscatter"),
    (r"pardon", "reset penalties"),
    (r"\bwear(s|ing)?\b( \w+)? (water|medium)", "apply the medium"),
    (r"(water|medium)( is| are| was)? taken away|tak(e|es|ing) the water away", "without the medium, restored"),
    (r"water's nine numbers", "coefficients of the medium"),
    (r"\b(met|meets?|meeting) again\b", "loop closure"),
    (r"(?<![a-z])believ(e|es|ed|ing)(?![a-z])", "trust, accept, estimate"),
    (r"(water|medium)('s)?[ _]?belief", "posterior of the medium"),
    (r"(?<![a-z])judg(e|es|ed|ing)(?![a-z])", "decide, validate, evaluate"),
    (r"(?<![a-z])(hurry|hurries|hurried|crowded)(?![a-z])", "skip depth, skip medium fit, late"),
    (r"bentness|economi[sz]e|prevailing_normals|as_seen|late_?losses", "see docs/glossary.md"),
    (r"(?<![a-z])lean(s|ed|ing)?[ _]on(?![a-z])", "use, depend on"),
    (r"(?<![a-z])weaken(s|ed|ing)?(?![a-z])", "downweight"),
    (r"no more is mapped", "mapping disabled; localization continues"),
    (r"memory (ends|ended|that ends)", "out of memory"),
    (r"what it reaches", "results"),
    (r"pose that counts", "fused trajectory"),
    (r"manieth", "every N-th"),
    (r"(?<![a-z])(let|lets|letting) go\b", "remove, prune"),
    (r"surveys? of the water|survey_water", "medium estimation"),
]
FORBIDDEN = [(re.compile(pattern, re.IGNORECASE), instead) for pattern, instead in PHRASES]

# Files (glob) that may contain what the regular expression matches.
EVERYTHING = r"[\s\S]*"
EXCEPTIONS = {
    "docs/glossary.md": EVERYTHING,  # lists such words
    "scripts/check_language.py": EVERYTHING,
    "scripts/codespell_words.txt": EVERYTHING,
    "src/config/renamed_keys.cpp": EVERYTHING,  # keys of version 0.1
    "tests/config/renamed_keys_test.cpp": EVERYTHING,
    "tests/sim/scene_renames_test.cpp": EVERYTHING,
    "tests/runs/run_config_test.cpp": r"believed|normalisation|sightings|belief",
    "docs/config.md": r"believed|normalisation|sightings|colour|centre|veil",  # its table of old keys
    "CHANGELOG.md": r"weakened|pictures?|murk|centre|normalisation",  # names that version 0.2 changed
    "mkdocs.yml": r"grey",  # a color of the theme
    "scripts/report/base.html.j2": r"picture",  # an element of HTML
    "tests/scripts/report_browser_test.py": r"PICTURE",
    "src/cli/sweep_slurm.cpp": r"CANCELLED",  # a state of Slurm's jobs
    "tests/cli/*": r"CANCELLED",
}


def allowed(name, match):
    return any(fnmatch.fnmatchcase(name, pattern) and re.fullmatch(words, match)
               for pattern, words in EXCEPTIONS.items())


def text_of(name):
    """The text of a file, or None if it is not text or does not exist."""
    path = ROOT / name
    if not path.is_file() or path.is_symlink():
        return None
    data = path.read_bytes()
    return None if b"\0" in data else data.decode("utf-8", errors="replace")


def our_files():
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    return sorted(set(listed.stdout.split("\0")) - {""})


def phrases_in(name, text):
    """Messages about the words of PHRASES in a file's name and text."""
    for pattern, instead in FORBIDDEN:
        if any(not allowed(name, match.group()) for match in pattern.finditer(name)):
            yield f"{name}: rename the file ({instead})"
        for match in pattern.finditer(text):
            if not allowed(name, match.group()):
                line = text.count("\n", 0, match.start()) + 1
                yield f"{name}:{line}: '{match.group()}': {instead}"


def misspellings(names):
    """Output lines of codespell, or None if it is not installed."""
    if not shutil.which("codespell"):
        return None
    command = ["codespell", "--builtin", "clear,rare,en-GB_to_en-US", "--ignore-words", str(WORDS),
               "--quiet-level", "3", "--", *names]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    lines = [line.removeprefix("./") for line in (done.stdout + done.stderr).splitlines() if line]
    return [line for line in lines if not renamed_key(line)]


def renamed_key(line):
    """Whether codespell rejects a word that EXCEPTIONS allows."""
    match = re.match(r"([^:]+):\d+: (\S+) ==>", line)
    return bool(match) and allowed(match.group(1), match.group(2))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("files", nargs="*", help="files to check; default: all")
    names = [str(pathlib.Path(name).resolve().relative_to(ROOT)) for name in parser.parse_args().files]
    texts = {name: text for name in names or our_files() if (text := text_of(name)) is not None}
    problems = [message for name, text in texts.items() for message in phrases_in(name, text)]
    spelling = misspellings(list(texts))
    problems += spelling or []
    print("\n".join(problems) or "language: clean")
    if spelling is None:
        print("language: spelling is not checked: codespell is not installed")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
