"""Tests of the installed Python package."""

import doctest
import inspect
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import OpenEXR

import nacre

NACRE = os.environ["NACRE_BIN"]


def nacre_run(*arguments):
    subprocess.run([NACRE, *map(str, arguments)], check=True, capture_output=True)


def documentation():
    for module in (nacre, nacre._running, nacre._photographs, nacre._session, nacre._client):
        failed, tried = doctest.testmod(module)
        assert failed == 0, module
    for name in nacre._native.operations():
        function = getattr(nacre, name)
        assert "Parameters" in function.__doc__ and "overwrite" in inspect.signature(function).parameters, name


def same_as_the_command_line():
    """Channels equal those that the OpenEXR library reads from the command line's files."""
    nacre_run("sim", "render", "--sample", "cd", "--size", 160, "--out", "session")
    nacre_run("reconstruct", "polarization", "session", "--out", "cli")
    stages = []
    result = nacre.polarization("session", "python", progress=lambda *state: stages.append(state))
    assert {p.name for p in Path("python").iterdir()} == {p.name for p in Path("cli").iterdir()}
    seen = 0
    for path in sorted(Path("cli").glob("*.exr")):
        for name, channel in OpenEXR.File(str(path), separate_channels=True).channels().items():
            np.testing.assert_array_equal(result[f"{path.stem}/{name}"], channel.pixels)
            seen += 1
    assert seen >= 6 and stages and all(0 <= done <= steps for _, done, steps in stages)
    assert result.report["method"] == "polarization" and result.summary
    assert result.sigma.shape == result.mask.shape == (160, 160) and 0.2 < result.mask.mean() < 1
    again = nacre.open("cli")
    np.testing.assert_array_equal(again["orientation"], result["orientation"])
    data = result.to_xarray()
    assert data["orientation"].dims == ("y", "x") and data["x"].attrs["units"] == "µm"
    session = nacre.open("session")
    assert len(session) == 12 and session[3].analyser_deg == 45 and session[3].array().dtype == np.uint16
    assert session.to_xarray().shape == (12, 160, 160)


def maps_pass_through_files():
    values = np.random.default_rng(1).random((30, 40)).astype(np.float32)
    values[3, 4] = np.nan
    nacre.write_maps("map.exr", {"units": "rad"}, orientation=values, sigma=2 * values)
    read = OpenEXR.File("map.exr", separate_channels=True).channels()
    np.testing.assert_array_equal(read["orientation"].pixels, values)
    maps = nacre.read_maps("map.exr")
    np.testing.assert_array_equal(maps["sigma"], 2 * values)
    assert maps.attributes["units"] == "rad" and list(maps) == ["orientation", "sigma"]
    for wrong in ({}, {"a": values, "b": values[1:]}, {"a": values[0]}):
        try:
            nacre.write_maps("wrong.exr", **wrong)
        except (ValueError, TypeError):
            continue
        raise AssertionError(wrong)


def faults_are_exceptions():
    for call, kind, words in [
        (lambda: nacre.polarization("no--where"), nacre.InputError, "no--where"),
        (lambda: nacre.lut("session", size=3), ValueError, "16 to 8192"),
        (lambda: nacre.polarization("session", "python"), nacre.InputError, "python"),
        (lambda: nacre.polarization("session", "/proc/nacre"), OSError, "/proc/nacre"),
        (lambda: nacre.Photographs(np.zeros((2, 3))), ValueError, "(2, 3)"),
        (lambda: nacre.Photographs(np.zeros((2, 3, 4)), analyser_deg=[0]), ValueError, "analyser_deg"),
        (lambda: nacre.open("."), nacre.InputError, "frames.json"),
        (lambda: nacre.polarization("session", model=object()), TypeError, "object"),
    ]:
        try:
            call()
        except kind as problem:
            assert words in str(problem), problem
        else:
            raise AssertionError(f"no {kind}")
    missed = nacre.polarization("session", max_error=1e-9).missed
    assert missed and "error" in missed, missed


def computations_are_interrupted():
    nacre_run("sim", "render", "--sample", "cd", "--size", 1200, "--out", "large")
    main = threading.main_thread().ident
    for stop in (lambda: signal.pthread_kill(main, signal.SIGINT), None):
        def progress(*_):
            if stop:
                stop()
            else:
                raise ArithmeticError("enough")
        try:
            nacre.polarization("large", "never", progress=progress)
        except (KeyboardInterrupt, ArithmeticError):
            assert not Path("never").exists()
            continue
        raise AssertionError("not interrupted")


def other_threads_run_meanwhile():
    """The interpreter's lock is free while Nacre computes."""
    counted, running = [0], [True]

    def count():
        while running[0]:
            counted[0] += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    before = counted[0]
    nacre.polarization("large")
    running[0] = False
    thread.join()
    assert counted[0] - before > 20, counted


def the_service_is_a_client_away():
    Path("bench.toml").write_text("camera = { width = 64, height = 48 }")
    service = subprocess.Popen([NACRE, "serve", "--sim", "--bench", "bench.toml", "--data", "data", "--listen", "127.0.0.1:0"], stderr=subprocess.PIPE, text=True)
    try:
        url = next(line.split()[3].rstrip("/,;") for line in service.stderr if line.startswith("Nacre is at"))
        threading.Thread(target=service.stderr.read, daemon=True).start()
        client = nacre.Client(url)
        plan = {"kind": "polarization", "name": "tile", "camera": {"exposure_ms": 10}, "analyser": {"angles_deg": [0, 45, 90, 135]}}
        session = client.capture(plan)
        assert session["frames_committed"] == 4
        names = [name for name, _ in zip((event[0] for event in client.events(session["id"])), range(3))]
        assert "state" in names, names
        result = client.compute("polarization", session["id"], model="sinusoid")
        assert result["state"] == "done" and result["report"]["method"] == "polarization"
        try:
            client.capture({"kind": "nothing"})
        except nacre.ServiceError as problem:
            assert problem.problem["status"] in (400, 422), problem.problem
        else:
            raise AssertionError("a wrong plan was taken")
    finally:
        service.terminate()
        service.wait()


for test in (documentation, same_as_the_command_line, maps_pass_through_files, faults_are_exceptions, computations_are_interrupted,
             other_threads_run_meanwhile, the_service_is_a_client_away):
    print(f"test {test.__name__} ...", end=" ", flush=True)
    test()
    print("ok")
print(f"Python {sys.version.split()[0]}, numpy {np.__version__}: nacre {nacre.__version__} works")
