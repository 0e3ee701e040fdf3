"""A disk that is full: one line about the recording, and watching goes on."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.real

FULL = """
import resource, sys, threading
from pathlib import Path
from protocol.codec import encode
from protocol.keys import Keys
from protocol.messages import Decision
from services.monitor.service import MonitorConfig, run
from services.runtime.memory_bus import MemoryBus, MemoryHub
from tests.services.monitor.feeder import Lesson

resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))  # a file system with so much room
hub, stop = MemoryHub(inline=True), threading.Event()
mine = MemoryBus(hub)
def ready(where):
    for message in Lesson(episodes=3).messages():
        key = Keys().decision if isinstance(message, Decision) else Keys().measures
        mine.publish(key(message.session), encode(message))
    stop.set()
counts = run(MonitorConfig(recording_dir=Path(sys.argv[1]), viewer=False), MemoryBus(hub), ready, stop)
print(counts.messages, counts.pictures)
"""


def test_a_full_disk_ends_the_recording_in_one_line_and_nothing_else(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(tmp_path)], capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    messages, pictures = map(int, done.stdout.split())
    assert messages > 300
    assert pictures > 100
    assert "the recording ends here" in done.stderr
    assert "`sfid export` writes it anew from the journal" in done.stderr
