"""A monitor in a process of its own, by whose clock time passes faster: hours of teaching in minutes.

    python tests/benchmarks/hurried_monitor.py ENDPOINT DEPLOYMENT FOLDER SCENE_PORT CURVES_PORT SPEED

With a clock of its own pace the periods of drawing and writing are as long in the session's time as they
are in a lesson; hours that are only sent fast would be drawn and written in far fewer, larger pieces.
SIGUSR1 ends the hurry.
"""

import signal
import sys
import threading
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from services.monitor.service import MonitorConfig, run
from services.runtime.clock import SystemClock
from services.runtime.zenoh_bus import open_bus


class HurriedClock(SystemClock):
    """The system's clock, so many times as fast until it is told to slow down."""

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self._since_ns = self._began_ns = super().now_ns()

    def now_ns(self) -> int:
        """See Clock."""
        return self._began_ns + int((super().now_ns() - self._since_ns) * self._speed)

    def slow_down(self) -> None:
        """Go on at the system's pace."""
        self._began_ns, self._since_ns, self._speed = self.now_ns(), super().now_ns(), 1.0


def main() -> None:
    """Watch until it is told to end."""
    endpoint, deployment, folder, scene_port, curves_port, speed = sys.argv[1:]
    stop = threading.Event()
    clock = HurriedClock(float(speed))
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    signal.signal(signal.SIGUSR1, lambda *_: clock.slow_down())
    bus = open_bus(endpoint, 20_000)
    config = MonitorConfig(
        deployment=deployment,
        recording_dir=Path(folder),
        scene_port=int(scene_port),
        curves_port=int(curves_port),
        web_port=None,
    )
    try:
        run(config, bus, lambda where: print(where, flush=True), stop, clock=clock)
    finally:
        bus.close()


if __name__ == "__main__":
    main()
