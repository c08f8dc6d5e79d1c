"""Texts of the program itself: help of every command, schemas of its files, and the OpenAPI document of the service."""

import json
import re
import subprocess
import threading
import time
import urllib.request


def commands(help_text):
    """Names of the subcommands that a help text lists."""
    listed = re.search(r"(?m)^Commands:\n((?:  .*\n)+)", help_text)
    names = re.findall(r"(?m)^  ([a-z][-a-z0-9]*) ", listed[1]) if listed else []
    return [name for name in names if name != "help"]


def helps(nacre, out):
    """Writes the help of every command: a file per command of the first level, with all below it."""
    def text(*command):
        printed = nacre.run([*command, "--help"])
        return f"$ nacre {' '.join([*command, '--help'])}\n{printed}\n", commands(printed)

    def below(*command):
        own, names = text(*command)
        return own + "".join(below(*command, name) for name in names)

    top, names = text()
    out("nacre.txt", top)
    for name in names:
        out(f"{name}.txt", below(name))


def schemas(nacre, out):
    """Writes every schema that the program prints."""
    listed = re.search(r"Possible values:\n((?: .*\n)+)", nacre.run(["schema", "--help"]))[1]
    for name in re.findall(r"(?m)^ +- ([a-z]+):", listed):
        out(f"{name}.json", nacre.run(["schema", name]))


def openapi(nacre, out):
    """Writes the OpenAPI document as a running service answers it."""
    process = nacre.start(["serve", "--sim", "--data", "data", "--listen", "127.0.0.1:0"])
    try:
        url = None
        for line in process.stderr:
            found = re.search(r"http://[0-9.]+:\d+", line)
            if found:
                url = found[0]
                break
        if not url:
            raise RuntimeError("nacre serve ended before it said where it listens")
        threading.Thread(target=process.stderr.read, daemon=True).start()
        deadline = time.monotonic() + 120
        while True:
            try:
                document = urllib.request.urlopen(f"{url}/api/v1/openapi.json", timeout=60).read()
                break
            except OSError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(0.2)
    finally:
        process.terminate()
        try:
            process.wait(60)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
    printed = json.loads(nacre.run(["schema", "openapi"]))
    served = json.loads(document)
    same = "equal to" if served == printed else "different from"
    out("served.txt", f"The document that the service answers is {same} `nacre schema openapi`.\n")
    if served != printed:
        out("served.json", json.dumps(served, indent=2, ensure_ascii=False) + "\n")


TEXTS = {"help": helps, "schema": schemas, "openapi": openapi}
