"""Runs the program in a folder, with an environment that is the same everywhere."""

import os
import shlex
import subprocess

# Longest time of one command in seconds: a guard against hanging, far above any case.
DEADLINE = 900


class Nacre:
    """The program under test, run in one folder."""

    def __init__(self, binary, folder):
        self.binary, self.folder = binary, folder
        # NACRE_* would override configurations, XDG_* and HOME say where the catalogue is.
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("NACRE_", "XDG_"))}
        self.environment = {**kept, "HOME": str(folder), "LC_ALL": "C.UTF-8", "TZ": "UTC", "NO_COLOR": "1"}
        self.environment.pop("COLUMNS", None)
        # `brdf` chooses its method by the time that it predicts for as many threads as there are.
        self.environment.setdefault("RAYON_NUM_THREADS", "2")

    def run(self, arguments, code=0):
        """Returns standard output; raises RuntimeError for another exit code."""
        done = subprocess.run([self.binary, *arguments], cwd=self.folder, env=self.environment, stdin=subprocess.DEVNULL,
                              capture_output=True, timeout=DEADLINE)
        if done.returncode != code:
            said = "\n".join(f"  {line}" for line in done.stderr.decode(errors="replace").splitlines()[-8:])
            raise RuntimeError(f"nacre {shlex.join(arguments)}\n  exit code {done.returncode}, expected {code}; it said:\n{said}")
        return done.stdout.decode()

    def start(self, arguments):
        return subprocess.Popen([self.binary, *arguments], cwd=self.folder, env=self.environment, stdin=subprocess.DEVNULL,
                                stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def step(nacre, line):
    """Runs a step of a case and returns its transcript."""
    command, _, note = line.partition(" # ")
    code = int(note.split()[1]) if note.startswith("code ") else 0
    return f"$ nacre {line}\n{nacre.run(shlex.split(command), code)}\n"
