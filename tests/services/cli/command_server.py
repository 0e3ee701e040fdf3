"""Forks a process a command, so that importing what every command imports is paid for once.

    python -P command_server.py FD

FD is one end of a socket pair. Each request on it is a JSON object (`arguments`, `environment`, `cwd`) with
four descriptors: stdin, stdout and stderr of the command, and a socket that is told its process id and its
exit code, each as a line. The server ends when the other end is closed.
"""

import json
import os
import socket
import sys
from contextlib import suppress

from services.cli.main import main

REQUEST_BYTES = 1 << 20


def serve(line: socket.socket) -> None:
    """Fork for each request, until there are no more; in a forked process, return to run its command."""
    while True:
        request, descriptors, _, _ = socket.recv_fds(line, REQUEST_BYTES, 4)
        if not request:
            sys.exit(0)
        if os.fork() == 0:
            line.close()
            mind(json.loads(request), descriptors)
            return
        for descriptor in descriptors:
            os.close(descriptor)
        with suppress(ChildProcessError):  # there is nobody left to bury
            while os.waitpid(-1, os.WNOHANG) != (0, 0):
                pass


def mind(request: dict[str, object], descriptors: list[int]) -> None:
    """Fork the command and stay behind to tell how it ended; in the command's process, return."""
    with socket.socket(fileno=descriptors[3]) as told:
        command = os.fork()
        if command:
            told.sendall(f"{command}\n".encode())
            _, status = os.waitpid(command, 0)
            told.sendall(f"{os.waitstatus_to_exitcode(status)}\n".encode())
            os._exit(0)
    for number, descriptor in enumerate(descriptors[:3]):
        os.dup2(descriptor, number)
        os.close(descriptor)
    sys.argv[:] = request["arguments"]  # type: ignore[call-overload]
    os.environ.clear()
    os.environ.update(request["environment"])  # type: ignore[call-overload]
    os.chdir(str(request["cwd"]))


if __name__ == "__main__":
    serve(socket.socket(fileno=int(sys.argv[1])))
    main()
