"""Runs a command and prints its exit code, CPU seconds, wall time and peak memory in MB; what it says goes to the first argument.

A process of its own, because Linux counts the memory of the process that starts a program as that program's.
"""

import os
import sys
import time

said = os.open(sys.argv[1], os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
begun = time.monotonic()
to_file = [(os.POSIX_SPAWN_DUP2, said, 1), (os.POSIX_SPAWN_DUP2, said, 2)]
child = os.posix_spawn(sys.argv[2], sys.argv[2:], os.environ, file_actions=to_file)
_, status, usage = os.wait4(child, 0)
print(os.waitstatus_to_exitcode(status), usage.ru_utime + usage.ru_stime, time.monotonic() - begun, usage.ru_maxrss / 1024)
