"""Two threads that end the process at once say so once."""

from __future__ import annotations

import subprocess
import sys

CODE = """
import os, signal, threading, time
from bayes_asv import cli
leave = os._exit
def slowly(status):
    time.sleep(0.3)
    leave(status)
os._exit = slowly
for _ in range(3):
    threading.Thread(target=cli._end, args=(signal.SIGTERM,)).start()
cli._end(signal.SIGTERM)
"""


def test_the_end_is_told_once() -> None:
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, check=False)
    assert done.returncode == 143
    assert done.stderr.decode().splitlines() == ["bayes-asv: terminated"]
