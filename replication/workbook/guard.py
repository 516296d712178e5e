"""Ends what a run of notebooks started when the run itself is gone. Executed as a program of its own.

It reads process groups from standard input, one per line: `+17` to look after, `-17` when that has ended. When the
input closes, because the run has ended in whatever way, it kills the groups that are left.
"""

import contextlib
import os
import select
import signal
import subprocess
import sys

import psutil


class Guard:
    """The run's end of the pipe: names process groups to the program and ends it."""

    def __init__(self, watched: int | None = None):
        """Start the program; where the process `watched` (make) is gone, it asks this one to end."""
        command = [sys.executable, __file__, str(watched or os.getpid()), str(os.getpid())]
        self.groups, self.is_over = set(), False
        self.program = subprocess.Popen(command, stdin=subprocess.PIPE, start_new_session=True, bufsize=0)

    def add(self, group: int) -> None:
        """Look after a process group; one that started while all were ended, is ended too."""
        if self.is_over:
            kill(group)
        self.groups.add(group)
        self.program.stdin.write(f"+{group}\n".encode())

    def end(self, group: int) -> None:
        """Kill what is left of a process group, and forget it."""
        kill(group)
        self.groups.discard(group)
        self.program.stdin.write(f"-{group}\n".encode())

    def end_all(self) -> None:
        """Kill every process group that is left, and those that are still to come."""
        self.is_over = True
        for group in tuple(self.groups):
            self.end(group)

    def close(self) -> None:
        """End the program, and with it every group that is left."""
        self.program.stdin.close()
        self.program.wait()


def kill(group: int) -> None:
    """Kill every process of a group, if any is left."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(group, signal.SIGKILL)


def is_alive(process: int) -> bool:
    """Whether a process runs: a dead one that nobody has waited for does not."""
    try:
        return psutil.Process(process).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def main(watched: int, run: int) -> None:
    """Look after the groups that come in, until the input closes."""
    groups, text = set(), ""
    while True:
        readable, _, _ = select.select([0], [], [], 0.5)
        if readable:
            received = os.read(0, 4096).decode()
            if not received:
                break
            *lines, text = (text + received).split("\n")
            for line in lines:
                (groups.add if line[0] == "+" else groups.discard)(int(line[1:]))
        elif not is_alive(watched):
            os.kill(run, signal.SIGTERM)
            watched = run
    for group in groups:
        kill(group)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
