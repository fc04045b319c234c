# SPDX-License-Identifier: BSD-3-Clause
"""Programs that talk to `apvi view` as a page does: HTTP and WebSocket (RFC 6455) on plain sockets."""
import base64
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import unittest

SKIPPED = 77  # exit status of a test, for CTest
TEXT, BINARY, CLOSE, PING, PONG = 1, 2, 8, 9, 10
DOWN = [0.0, 1.0, 0.0, 0.0]  # a camera that looks along -z
HEADER = struct.Struct("<BBBxIIHHff")


def why_no_viewer(apvi):
    done = subprocess.run([apvi, "view", "--help"], capture_output=True, text=True)
    return "this build has no mapping" if "not in this build" in done.stdout else None


def run_tests(why_not=None):
    """Runs the tests of the program, or skips all of them for a reason."""
    if why_not:
        print(f"skipped: {why_not}")
        sys.exit(SKIPPED)
    unittest.main(argv=[sys.argv[0], "-v", *sys.argv[1:]])


class Server:
    """`apvi view` of a run, or another command that prints the address of a page."""

    def __init__(self, *command):
        self.process = subprocess.Popen([str(c) for c in command], stdout=subprocess.DEVNULL,
                                        stderr=subprocess.PIPE, text=True)
        self.log = ""
        for line in self.process.stderr:
            self.log += line
            found = re.search(r"http://([^:/ ]+):(\d+)/(\?token=[\w-]+)?", line)
            if found:
                self.url, self.port, self.query = found.group(), int(found.group(2)), found.group(3) or ""
                return
        raise AssertionError(f"no address in: {self.log}")

    def memory_kib(self):
        with open(f"/proc/{self.process.pid}/status", encoding="utf-8") as status:
            return int(re.search(r"VmRSS:\s+(\d+)", status.read()).group(1))

    def stop(self):
        self.process.send_signal(signal.SIGINT)
        _, rest = self.process.communicate(timeout=600)
        self.log += rest
        return self.process.returncode


def connect(port):
    stream = socket.create_connection(("127.0.0.1", port), timeout=600)
    stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return stream


def request(port, data):
    """The whole answer to the bytes of a request; empty if the connection was closed without one."""
    with connect(port) as stream:
        answer = b""
        try:
            stream.sendall(data)
            stream.shutdown(socket.SHUT_WR)
            while chunk := stream.recv(65536):
                answer += chunk
        except OSError:
            pass
        return answer


def get(port, target="/", method="GET", **headers):
    fields = {"Host": f"127.0.0.1:{port}", **{name.replace("_", "-"): value for name, value in headers.items()}}
    lines = [f"{method} {target} HTTP/1.1", *(f"{name}: {value}" for name, value in fields.items()), "", ""]
    return request(port, "\r\n".join(lines).encode())


def status(answer):
    return int(answer.split(b" ", 2)[1]) if answer else 0


def frame(data, opcode=TEXT, first=0x80, masked=True):
    """A frame of a client; `first`: the bits of its first byte but the opcode."""
    length = len(data)
    head = bytes([first | opcode])
    mask_bit = 0x80 if masked else 0
    if length < 126:
        head += bytes([mask_bit | length])
    else:
        head += bytes([mask_bit | 126]) + struct.pack(">H", length)
    if not masked:
        return head + data
    mask = os.urandom(4)
    return head + mask + bytes(b ^ mask[i % 4] for i, b in enumerate(data))


class Page:
    """A watcher. Images are answered as drawn."""

    def __init__(self, port, query="", origin=None):
        self.stream = connect(port)
        lines = [f"GET /socket{query} HTTP/1.1", f"Host: 127.0.0.1:{port}", "Upgrade: websocket", "Connection: Upgrade",
                 f"Sec-WebSocket-Key: {base64.b64encode(os.urandom(16)).decode()}", "Sec-WebSocket-Version: 13"]
        lines += [f"Origin: {origin}"] if origin else []
        self.stream.sendall("\r\n".join([*lines, "", ""]).encode())
        self.buffer = b""
        while b"\r\n\r\n" not in self.buffer:
            chunk = self.stream.recv(65536)
            if not chunk:
                break
            self.buffer += chunk
        head, _, self.buffer = self.buffer.partition(b"\r\n\r\n")
        self.status = status(head)
        self.scene = json.loads(self.receive()[1]) if self.status == 101 else None

    def close(self):
        self.stream.close()

    def read(self, count):
        while len(self.buffer) < count:
            chunk = self.stream.recv(1 << 20)
            if not chunk:
                raise ConnectionError("closed")
            self.buffer += chunk
        data, self.buffer = self.buffer[:count], self.buffer[count:]
        return data

    def receive(self):
        """(opcode, data) of the next message."""
        first, length = self.read(2)
        if length == 126:
            length = struct.unpack(">H", self.read(2))[0]
        elif length == 127:
            length = struct.unpack(">Q", self.read(8))[0]
        return first & 15, self.read(length)

    def send(self, **message):
        self.stream.sendall(frame(json.dumps(message).encode()))

    def look(self, view_id=1, position=(0.0, 0.0, 0.0), moving=False, kind="view", **changes):
        message = {"type": kind, "id": view_id, "width": 320, "height": 240, "focal": 0.8, "layer": "seen",
                   "water": 1.0, "pose": [*DOWN, *position], "moving": moving}
        self.send(**{**message, **changes})

    def image(self):
        """(header, bytes) of the next image: kind, layer, complete, id, view, width, height, near, far."""
        while True:
            opcode, data = self.receive()
            if opcode == PING:
                self.stream.sendall(frame(data, PONG))
            if opcode == CLOSE:
                raise ConnectionError("closed")
            if opcode != BINARY:
                continue
            header = HEADER.unpack(data[:HEADER.size])
            if header[0] == 1:
                self.send(type="drawn", frame=header[3])
            return header, data[HEADER.size:]

    def reply(self, kind=None):
        """The next JSON message, of a kind if one is given."""
        while True:
            opcode, data = self.receive()
            message = json.loads(data) if opcode == TEXT else None
            if message and kind in (None, message["type"]):
                return message
