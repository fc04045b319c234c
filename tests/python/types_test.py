# SPDX-License-Identifier: BSD-3-Clause
"""The type annotations are those of the extension module, and the examples keep to them."""
import importlib.util
import pathlib
import subprocess
import sys
import unittest

import support


# Of pybind11's classes, and of those that Python code does not make.
OF_EVERY_CLASS = ("metaclass differs", 'does not have *args parameter "args"')


def mypy(module, *arguments):
    done = subprocess.run([sys.executable, "-m", module, *map(str, arguments)], capture_output=True, text=True,
                          cwd=support.scratch(), check=False)
    return done.returncode, done.stdout + done.stderr


@unittest.skipUnless(importlib.util.find_spec("mypy"), "mypy is not installed")
class Types(unittest.TestCase):
    def test_annotations_name_what_the_module_has(self):
        _, output = mypy("mypy.stubtest", "apvi", "--concise", "--ignore-disjoint-bases")
        problems = [line for line in output.splitlines() if not line.endswith(OF_EVERY_CLASS)]
        self.assertEqual(problems, [])
        self.assertIn("apvi._apvi.System is inconsistent, metaclass differs", output)  # it was compared

    def test_examples_keep_to_the_annotations(self):
        examples = sorted((support.ROOT / "examples" / "python").glob("*.py"))
        code, output = mypy("mypy", "--strict", "--python-version", "3.11", *examples)
        self.assertEqual(code, 0, output)

    def test_wrong_use_is_found(self):
        path = pathlib.Path(support.scratch()) / "wrong.py"
        path.write_text("import apvi\napvi.ImuSample('now', [0, 0, 0], [0, 0, 9.8])\n")
        code, output = mypy("mypy", "--strict", path)
        self.assertEqual(code, 1, output)
        self.assertIn('expected "int"', output)


if __name__ == "__main__":
    support.main()
