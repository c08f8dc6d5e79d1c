"""A USB camera for the guest's own uvcvideo: bulk transfers, grey of 640 × 480 with exposure and gain that act two frames
late, and JPEG files of 16 × 8 without Huffman tables. It speaks USB/IP with the kernel's virtual host controller. With an
argument, its cable is pulled after this time in seconds.
"""
import collections
import socket
import struct
import sys
import threading
import time
from pathlib import Path

WIDTH, HEIGHT = 640, 480
INTERVALS = (666666, 2000000)  # 100 ns
TRANSFER = 16384
LAG = 2
STALL = -32
UNLINKED = -104  # ECONNRESET

GREY = b"Y800" + bytes.fromhex("0000 1000 8000 00aa00389b71")
JPEG_WIDTH, JPEG_HEIGHT = 16, 8
HUFFMAN_TABLES, SCAN = 0xC4, 0xDA


def jpeg():
    """The file without its Huffman tables."""
    file = (Path(__file__).parents[2] / "drivers/src/camera/v4l2/grey.jpg").read_bytes()
    bare, at = file[:2], 2
    while file[at + 1] != SCAN:
        end = at + 2 + int.from_bytes(file[at + 2 : at + 4], "big")
        bare += b"" if file[at + 1] == HUFFMAN_TABLES else file[at:end]
        at = end
    return bare + file[at:]


def descriptor(kind, *parts):
    body = bytes([kind]) + b"".join(p if isinstance(p, bytes) else bytes([p]) for p in parts)
    return bytes([len(body) + 1]) + body


def u16(n):
    return struct.pack("<H", n)


def u32(n):
    return struct.pack("<I", n)


DEVICE = descriptor(1, u16(0x200), 0xEF, 2, 1, 64, u16(0x1209), u16(0x0003), u16(0x100), 1, 2, 3, 1)
STRINGS = {0: u16(0x0409)} | {n: s.encode("utf-16le") for n, s in enumerate(["Nacre", "Simulated camera", "SN7"], 1)}


def configuration():
    terminal = descriptor(0x24, 2, 1, u16(0x201), 0, 0, bytes(6), 3, bytes([0x0A, 0, 0]))  # automatic, absolute exposure
    unit = descriptor(0x24, 5, 2, 1, u16(0), 2, bytes([0, 2]), 0)  # gain
    output = descriptor(0x24, 3, 3, u16(0x101), 0, 2, 0)
    total = 13 + len(terminal + unit + output)
    control = descriptor(0x24, 1, u16(0x100), u16(total), u32(48_000_000), 1, 1) + terminal + unit + output

    def frame(kind, width, height):
        size = max(width * height, 4096)
        return descriptor(
            0x24, kind, 1, 0, u16(width), u16(height), u32(size * 40), u32(size * 120), u32(size),
            u32(INTERVALS[0]), len(INTERVALS), *map(u32, INTERVALS),
        )

    pixels = descriptor(0x24, 4, 1, 1, GREY, 8, 1, bytes(4)) + frame(5, WIDTH, HEIGHT)
    files = descriptor(0x24, 6, 2, 1, 0, 1, bytes(4)) + frame(7, JPEG_WIDTH, JPEG_HEIGHT)
    total = 15 + len(pixels + files)
    stream = descriptor(0x24, 1, 2, u16(total), 0x81, 0, 3, bytes(3), 1, 0, 0) + pixels + files
    body = descriptor(11, 0, 2, 14, 3, 0, 0)
    body += descriptor(4, 0, 0, 0, 14, 1, 0, 0) + control
    body += descriptor(4, 1, 0, 1, 14, 2, 0, 0) + stream + descriptor(5, 0x81, 2, u16(512), 0)
    return bytes([9, 2]) + u16(9 + len(body)) + bytes([2, 1, 0, 0x80, 250]) + body


class Control:
    def __init__(self, size, low, high, now):
        self.size, self.low, self.high, self.start, self.now = size, low, high, now, now

    def answer(self, request):
        """GET_CUR and its kin."""
        if request == 0x85:
            return u16(self.size)
        if request == 0x86:
            return b"\x03"
        step = 9 if self.size == 1 else 1  # of the mode: which there are
        values = {0x81: self.now, 0x82: self.low, 0x83: self.high, 0x84: step, 0x87: self.start}
        return values[request].to_bytes(self.size, "little") if request in values else None


class Camera:
    def __init__(self, link):
        self.link = link
        self.exposure, self.gain = Control(4, 1, 10000, 156), Control(2, 0, 255, 16)
        # By unit and selector.
        self.controls = {(1, 2): Control(1, 1, 8, 8), (1, 4): self.exposure, (2, 4): self.gain}
        self.interval = INTERVALS[0]
        self.format = 1  # of those in the configuration
        self.waiting = collections.deque()  # bulk transfers that the host asked for
        self.changed = threading.Condition()
        self.streaming = False

    def reply(self, sequence, status, data=b"", length=None):
        length = len(data) if length is None else length
        self.link.sendall(struct.pack(">5I5i8x", 3, sequence, 0, 0, 0, status, length, 0, 0, 0) + data)

    def settings(self):
        return struct.pack("<HBBIHHHHHII", 1, self.format, 1, self.interval, 0, 0, 0, 0, 0, WIDTH * HEIGHT, TRANSFER)

    def standard(self, kind, request, value):
        if kind & 0x80 and request == 6:
            known = {1: DEVICE, 2: configuration()}
            if value >> 8 == 3 and value & 255 in STRINGS:
                text = STRINGS[value & 255]
                return bytes([len(text) + 2, 3]) + text
            return known.get(value >> 8)
        return b"\0\0" if kind & 0x80 else b""

    def request(self, setup, data):
        """What a control transfer returns; None to refuse it."""
        kind, request, value, index, _ = struct.unpack("<BBHHH", setup)
        if kind & 0x60 == 0:
            return self.standard(kind, request, value)
        unit, interface, selector = index >> 8, index & 255, value >> 8
        if interface == 1:
            return self.negotiate(request, selector, data)
        control = self.controls.get((unit, selector))
        if control and request == 1:
            control.now = int.from_bytes(data[: control.size], "little")
            return b""
        return control and control.answer(request)

    def negotiate(self, request, selector, data):
        if request == 1:
            self.format = 2 if data[2] == 2 else 1
            wanted = struct.unpack_from("<I", data, 4)[0]
            self.interval = wanted if wanted in INTERVALS else INTERVALS[0]
            if selector == 2:
                with self.changed:
                    self.streaming = True
                    self.changed.notify()
            return b""
        return {0x85: u16(26), 0x86: b"\x03"}.get(request, self.settings())

    def receive(self, count):
        data = b""
        while len(data) < count:
            more = self.link.recv(count - len(data))
            if not more:
                raise EOFError
            data += more
        return data

    def serve(self):
        while True:
            header = self.receive(48)
            command, sequence, _, inwards, endpoint = struct.unpack_from(">5I", header)
            if command == 2:
                self.unlink(sequence, struct.unpack_from(">I", header, 20)[0])
                continue
            length = struct.unpack_from(">i", header, 24)[0]
            data = self.receive(length) if not inwards else b""
            with self.changed:
                if endpoint:
                    self.waiting.append((sequence, length))
                    self.changed.notify()
                    continue
                answer = self.request(header[40:], data)
                if answer is None:
                    self.reply(sequence, STALL)
                else:
                    self.reply(sequence, 0, answer[:length] if inwards else b"", None if inwards else length)

    def unlink(self, sequence, unwanted):
        with self.changed:
            found = [w for w in self.waiting if w[0] == unwanted]
            for entry in found:
                self.waiting.remove(entry)
                self.streaming = False
            status = UNLINKED if found else 0
            self.link.sendall(struct.pack(">5Ii24x", 4, sequence, 0, 0, 0, status))

    def film(self):
        number, levels = 0, collections.deque(maxlen=LAG + 1)
        while True:
            with self.changed:
                self.changed.wait_for(lambda: self.streaming and self.waiting)
            time.sleep(self.interval / 1e7)
            levels.append(min(255, self.exposure.now * self.gain.now // 16))
            number += 1
            self.send(jpeg() if self.format == 2 else bytes([levels[0]]) * (WIDTH * HEIGHT), number & 1)

    def send(self, frame, parity):
        sent = 0
        while sent < len(frame):
            # A transfer is taken and answered under one lock, or it could be called back in between.
            with self.changed:
                self.changed.wait_for(lambda: self.waiting or not self.streaming)
                if not self.streaming:
                    return
                sequence, length = self.waiting.popleft()
                part = frame[sent : sent + min(length, TRANSFER) - 2]
                sent += len(part)
                last = 2 if sent == len(frame) else 0
                self.reply(sequence, 0, bytes([2, 0x80 | parity | last]) + part)


def unless_pulled(work):
    try:
        work()
    except (EOFError, OSError):
        pass


def main():
    host, device = socket.socketpair()
    camera = Camera(device)
    for work in (camera.serve, camera.film):
        threading.Thread(target=unless_pulled, args=[work], daemon=True).start()
    high_speed = 3
    with open("/sys/devices/platform/vhci_hcd.0/attach", "w") as attach:
        attach.write(f"0 {host.fileno()} {0x10002} {high_speed}")
    host.close()
    time.sleep(float(sys.argv[1]) if len(sys.argv) > 1 else 1e6)
    device.shutdown(socket.SHUT_RDWR)
    time.sleep(1)


main()
