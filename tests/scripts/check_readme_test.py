#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Tests of scripts/check_readme.py."""
import pathlib
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "scripts"))

import check_readme  # noqa: E402

TEXT = """
```yaml
key: value
```

```sh
apvi run dive
```

```text
a diagram
```

    ```
    apvi doctor dive
    ```
apvi outside
"""


class CodeLines(unittest.TestCase):
    def test_shell_blocks_after_other_blocks_are_read(self):
        lines = [line.strip() for _, line in check_readme.code_lines(TEXT)]
        self.assertEqual(lines, ["apvi run dive", "apvi doctor dive"])

    def test_line_numbers_start_at_one(self):
        self.assertEqual(list(check_readme.code_lines("```sh\nls\n```")), [(2, "ls")])

    def test_unknown_command_is_a_problem(self):
        self.assertEqual(list(check_readme.problems_in("apvi fly dive", set(), {"run"})),
                         ["apvi has no command fly"])


if __name__ == "__main__":
    unittest.main()
