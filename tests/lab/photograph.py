"""Compares an emulated screen with what a test says that it drew: for each N.ppm, a screen dump; then N.taken."""
import json
import pathlib
import socket
import sys
import time

PICTURES = 4


def wait_for(condition, seconds=300):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            sys.exit("no picture was asked for")
        time.sleep(0.2)


def command(stream, name, **arguments):
    stream.write(json.dumps({"execute": name, "arguments": arguments}) + "\n")
    stream.flush()
    while True:
        answer = json.loads(stream.readline())
        if "return" in answer or "error" in answer:
            return answer


def main():
    port, folder = sys.argv[1], pathlib.Path(sys.argv[2])
    wrong = 0
    for number in range(PICTURES):
        drawn = folder / f"{number}.ppm"
        wait_for(drawn.exists)
        link = socket.socket(socket.AF_UNIX)
        link.connect(port)
        stream = link.makefile("rw")
        stream.readline()
        command(stream, "qmp_capabilities")
        dump = folder / f"{number}.dump"
        command(stream, "screendump", filename=str(dump))
        same = dump.read_bytes() == drawn.read_bytes()
        size = drawn.read_bytes().split(b"\n", 2)[1].decode()
        print(f"picture {number} of {size}: {'the same' if same else 'another one'} on the screen", flush=True)
        wrong += not same
        drawn.with_suffix(".taken").touch()
        link.close()
    sys.exit(wrong > 0)


main()
