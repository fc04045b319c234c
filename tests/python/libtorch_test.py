# SPDX-License-Identifier: BSD-3-Clause
"""The package beside the Python package torch, before and after it.

Where torch is not installed, a package of that name with a LibTorch of its own stands for it."""
import importlib.util
import os
import pathlib
import unittest
import unittest.mock

import support

BOTH = """
import sys
sys.path[:0] = sys.argv[2:]
def ours():
    import apvi, numpy
    snapshot = apvi.MapSnapshot.read(sys.argv[1])
    images = snapshot.render(apvi.Camera(50, 50, 31.5, 23.5, 64, 48), numpy.eye(4))
    assert images.alpha.max() > 0.5, images.alpha.max()
def theirs():
    import torch
    x = torch.randn(64, 64, requires_grad=True)
    (x @ x).relu().sum().backward()
    torch.nn.Conv2d(3, 8, 3)(torch.randn(1, 3, 32, 32)).sum().backward()
try:
    ORDER
except ImportError as error:
    print("refused:", error)
else:
    print("both work")
"""
MAP = """ply
format ascii 1.0
element vertex 1
property float x
property float y
property float z
property float f_dc_0
property float f_dc_1
property float f_dc_2
property float opacity
property float scale_0
property float scale_1
property float scale_2
property float rot_0
property float rot_1
property float rot_2
property float rot_3
end_header
0 0 2 1 0 0 4 -1 -1 -1 1 0 0 0
"""
PRETENDED = """
class Anything:
    def __call__(self, *arguments, **more): return self
    def __getattr__(self, name): return self
    def __matmul__(self, other): return self
randn = nn = Anything()
"""
ORDERS = {"first": "ours(); theirs(); ours()", "last": "theirs(); ours(); theirs()"}


def use_both(order, *folders):
    path = support.scratch() / "one.ply"
    path.write_text(MAP)
    result = support.python(BOTH.replace("ORDER", ORDERS[order]), path, *folders)
    return result.returncode, result.stdout, result.stderr


class OtherLibtorch(unittest.TestCase):
    def pretended(self):
        folder = support.scratch() / "pretended"
        (folder / "torch" / "lib").mkdir(parents=True, exist_ok=True)
        (folder / "torch" / "__init__.py").write_text(PRETENDED)
        (folder / "torch" / "version.py").write_text("__version__ = '9.8.7+cu130'\n")
        (folder / "torch" / "lib" / "libtorch_cpu.so").touch()
        return folder

    def test_second_import_is_refused_with_the_remedy(self):
        for order in ORDERS:
            code, output, errors = use_both(order, self.pretended())
            self.assertEqual((code, output[:8]), (0, "refused:"), errors)
            self.assertIn("torch 9.8.7", output)
            self.assertIn("CMAKE_PREFIX_PATH=", output)


class SameLibtorch(unittest.TestCase):
    def test_package_without_a_libtorch_of_its_own_is_accepted(self):
        from apvi import _libtorch
        folder = support.scratch() / "without" / "torch"
        folder.mkdir(parents=True, exist_ok=True)
        self.assertIsNone(_libtorch.conflict(folder))

    def test_package_with_the_same_file_is_accepted(self):
        from apvi import _libtorch
        folder = support.scratch() / "linked" / "torch"
        (folder / "lib").mkdir(parents=True, exist_ok=True)
        os.symlink(_libtorch.LIBTORCH, folder / "lib" / "libtorch_cpu.so")
        self.assertIsNone(_libtorch.conflict(folder))

    def test_wheel_of_the_same_version_is_accepted(self):
        from apvi import _libtorch
        ours, folder = support.scratch() / "wheel" / "libtorch_cpu.so", support.scratch() / "wheel2" / "torch"
        (folder / "lib").mkdir(parents=True, exist_ok=True)
        ours.parent.mkdir(exist_ok=True)
        for path in (ours, folder / "lib" / "libtorch_cpu.so"):
            path.touch()
        with unittest.mock.patch.multiple(_libtorch, LIBTORCH=str(ours), TORCH_VERSION="2.11.0"):
            (folder / "version.py").write_text("__version__ = '2.11.0+cpu'\n")
            self.assertIsNone(_libtorch.conflict(folder))
            (folder / "version.py").write_text("__version__ = '2.10.0+cpu'\n")
            self.assertIn("torch 2.10.0", _libtorch.conflict(folder))


@unittest.skipUnless(importlib.util.find_spec("torch"), "torch is not installed")
class RealTorch(unittest.TestCase):
    def test_both_orders_work_or_the_second_import_is_refused(self):
        from apvi import _libtorch
        folder = pathlib.Path(importlib.util.find_spec("torch").origin).parent
        refused = _libtorch.conflict(folder) is not None
        for order in ORDERS:
            code, output, errors = use_both(order)
            self.assertEqual((code, output[:7]), (0, "refused" if refused else "both wo"), errors)


if __name__ == "__main__":
    support.main()
