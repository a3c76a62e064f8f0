"""The firmware on emulated boards: sampling, synchronisation, transfer, faults.

Expected figures come from the emulator's own log of what happened (`tests.firmware.truth`) and from
``firmware/PROTOCOL.md``; the laptop is `tests.firmware.laptop`.  Virtual time only: every run
repeats to the byte.  Longer runs of the same kind are in ``benchmarks/logger.py``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.firmware.checks import ROWS, check_rows, check_times
from tests.firmware.frames import (
    HELLO,
    MASTER,
    SLAVE_1,
    STANDBY,
    WAITING,
)
from tests.firmware.laptop import NoAnswerError
from tests.firmware.logger import switched_on, why_not
from tests.firmware.scenarios import (
    Setup,
)
from tests.firmware.truth import predicted_times, synch_pulses

REASON = why_not()
pytestmark = pytest.mark.skipif(REASON is not None, reason=str(REASON))


def test_a_run_at_800_hz_with_six_steps_and_crystals_100_ppm_apart(tmp_path: Path) -> None:
    setup = Setup(seed=1, ppm=(50.0, -50.0, 0.0), extra=("log adc wires",))
    with switched_on(tmp_path, setup) as logger:
        emulated, laptop = logger.emulated, logger.laptop
        since = logger.start(800)
        logger.finish()
        blocks = logger.transfer()
        laptop.wait_for("Slave 1: all sent", 10)
        assert logger.state() == STANDBY
        logger.check_nothing_lost()
        ram = emulated.totals("board", name="slave_1")["ram_free"]

        for block in blocks:
            assert block.head.rate == 800
            assert 4e6 / (block.head.prescale * block.head.cycles) == 800
            assert block.head.overruns == block.head.saturated == 0
        front, rear = check_rows(emulated, blocks, since)
        # Four pulses: reset, check, start, end.
        pulses = synch_pulses(emulated, since)
        assert len(pulses) == 4
        # At the start the boards sample at the same instants; after a second 100 ppm are 100 us.
        skew = rear.time - front.time
        assert np.abs(skew[0]).max() < 5e-6
        assert skew[-1] == pytest.approx(100e-6 * (ROWS - 1) / 800, abs=3e-6)
        check_times(blocks, [front, rear], pulses[2], 50.0)
        # Steps 3 and 4 measured the drift between the first two pulses.
        expected = -100e-6 * (pulses[1] - pulses[0]) * 4e6
        assert blocks[1].times.difference == pytest.approx(expected, abs=2)
        assert ram >= 300
    assert laptop.repeats == 0


def test_a_run_at_400_hz_synchronised_by_radio_alone(tmp_path: Path) -> None:
    setup = Setup(seed=2, ppm=(-20.0, 45.0, 0.0), extra=("log adc wires", "at 0.1 cut synch"))
    with switched_on(tmp_path, setup) as logger:
        since = logger.start(400, synch=2)
        logger.finish()
        blocks = logger.transfer()
        front, rear = check_rows(logger.emulated, blocks, since)
        start = float(front.time[0, 0] - predicted_times(*blocks, -20.0)[0, 0, 0])
        check_times(blocks, [front, rear], start, -20.0)
        assert all(block.head.overruns == 0 for block in blocks)
        logger.check_nothing_lost()
        assert synch_pulses(logger.emulated, since) == []


def test_everything_arrives_over_a_bad_link(tmp_path: Path) -> None:
    setup = Setup(seed=3, ppm=(30.0, -10.0, 0.0), loss=0.2, error_rate=1e-3, extra=("log adc",))
    with switched_on(tmp_path, setup) as logger:
        since = logger.start(800)
        logger.finish()
        blocks = logger.transfer()
        check_rows(logger.emulated, blocks, since)
        logger.emulated.statistics()
        assert logger.emulated.totals("air")["lost"] > 20
        assert logger.laptop.spoilt > 10
        assert logger.emulated.totals("modem", name="vehicle")["spoilt"] > 20
        assert logger.emulated.totals("modem", name="vehicle")["overflowed"] == 0


@pytest.mark.parametrize(("pin", "board", "count"), [("slave_1.A1", 1, 1023), ("slave_2.A0", 2, 0)])
def test_ten_readings_at_a_rail_abort_the_run(
    tmp_path: Path, pin: str, board: int, count: int
) -> None:
    inputs = [line for line in Setup().inputs if pin not in line]
    setup = Setup(seed=4, inputs=(*inputs, f"input {pin} counts={count}"))
    with switched_on(tmp_path, setup) as logger:
        logger.start(400)
        logger.laptop.wait_for(f"Slave {board}: saturated", 5)
        assert logger.state() == STANDBY
        assert "Slave 1: run done" not in logger.laptop.events


def test_a_cut_synch_wire_is_noticed_and_a_mended_one_serves(tmp_path: Path) -> None:
    with switched_on(tmp_path, Setup(seed=5)) as logger:
        logger.emulated.do("cut synch")
        logger.start(800)
        logger.laptop.wait_for("Slave 2: no pulse", 10)
        assert logger.state() == STANDBY
        logger.emulated.do("mend synch")
        logger.start(800)
        logger.finish()
        assert logger.state() == WAITING


def test_a_wire_cut_during_the_run_is_told_and_the_end_is_marked_by_radio(tmp_path: Path) -> None:
    setup = Setup(seed=6, ppm=(40.0, -35.0, 0.0), extra=("log adc wires",))
    with switched_on(tmp_path, setup) as logger:
        since = logger.start(800)
        logger.laptop.wait_for("Slave 1: run started", 5)
        logger.emulated.do("cut synch")
        logger.finish()
        blocks = logger.transfer()
        logger.laptop.wait_for("Slave 2: no pulse", 10)
        truths = check_rows(logger.emulated, blocks, since)
        check_times(blocks, truths, synch_pulses(logger.emulated, since)[2], 40.0)


@pytest.mark.parametrize("board", ["slave_1", "slave_2"])
def test_a_reset_during_the_transfer_is_told_and_the_next_run_is_whole(
    tmp_path: Path, board: str
) -> None:
    with switched_on(tmp_path, Setup(seed=7, extra=("log adc",))) as logger:
        laptop, emulated = logger.laptop, logger.emulated
        logger.start(800)
        logger.finish()
        front = laptop.fetch(SLAVE_1) if board == "slave_2" else None
        if front is not None:
            emulated.do("reset slave_2 for 5 ms")
            assert laptop.done(SLAVE_1, front) == 0
            laptop.wait_for("Slave 2: run lost", 20)
        else:
            with pytest.raises(NoAnswerError):
                laptop.fetch(SLAVE_1, within=2.0)
            emulated.do("reset slave_1 for 5 ms")
            laptop.listen(4.0)
        assert logger.state() == STANDBY
        laptop.events.clear()
        since = logger.start(800)
        logger.finish()
        check_rows(emulated, logger.transfer(), since)


def test_a_slave_2_that_is_off_is_named(tmp_path: Path) -> None:
    with switched_on(tmp_path, Setup(seed=8, extra=("at 0.05 block air",))) as logger:
        logger.start(800)
        logger.laptop.wait_for("Slave 2: no answer", 20)
        assert logger.state() == STANDBY


def test_the_master_carries_frames_both_ways(tmp_path: Path) -> None:
    setup = Setup(seed=9, ppm=(20.0, -20.0, 60.0), loss=0.1, error_rate=1e-4, extra=("log adc",))
    with switched_on(tmp_path, setup, master=True) as logger:
        hello = logger.laptop.ask(HELLO, to=MASTER)
        assert hello[1] == MASTER
        assert logger.laptop.ask(HELLO)[1] == SLAVE_1
        since = logger.start(800)
        logger.finish()
        check_rows(logger.emulated, logger.transfer(), since)
