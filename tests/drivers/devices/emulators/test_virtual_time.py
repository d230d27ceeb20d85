"""Threads under the virtual clock take turns: one at a time, in one order, and time passes for all of them alike."""

import threading
import time

from pomona.devices.emulators.pipes import LATE, Pipe
from pomona.devices.emulators.virtual_time import VirtualTime
from pomona.executive.cell.owner import Owner, TurnTaking
from pomona.executive.clock import ManualClock

PERIOD = 0.002


class Steps(ManualClock):
    """A world of nothing."""


def test_it_is_a_clock_that_gives_threads():
    assert isinstance(VirtualTime(Steps(), PERIOD), TurnTaking)


def test_two_threads_that_sleep_wake_in_the_order_in_which_they_were_started():
    clock = VirtualTime(Steps(), PERIOD)
    told = []

    def sleeper(name, period):
        def run():
            for _ in range(4):
                clock.advance(period)
                told.append((name, round(1e3 * clock.now())))

        return run

    threads = [clock.thread("a", sleeper("a", 0.006)), clock.thread("b", sleeper("b", 0.003))]
    for thread in threads:
        thread.start()
    clock.advance(0.012)
    # Started in the first step, at 2 ms; what is no whole step is waited for until the next.
    assert told == [("b", 6), ("a", 8), ("b", 10)]
    for thread in threads:
        thread.join(1.0)
    assert [name for name, _ in told].count("a") == 4


def test_only_one_thread_runs_at_a_time():
    clock = VirtualTime(Steps(), PERIOD)
    inside, most = [0], [0]

    def run():
        for _ in range(200):
            inside[0] += 1
            most[0] = max(most[0], inside[0])
            time.sleep(0)  # invites a switch
            inside[0] -= 1
            clock.advance(PERIOD)

    threads = [clock.thread(str(i), run) for i in range(3)]
    for thread in threads:
        thread.start()
    clock.advance(0.5)
    assert most[0] == 1
    assert not any(thread.is_alive() for thread in threads if thread.join(1.0) is None)


def test_a_thread_that_polls_without_end_does_not_stop_the_world():
    clock = VirtualTime(Steps(), PERIOD)
    polls = [0]
    done = threading.Event()

    def run():
        while not done.is_set():
            polls[0] += 1
            clock.wait(0.0, lambda: False)

    thread = clock.thread("poller", run)
    thread.start()
    clock.advance(0.1)
    assert 50 <= polls[0] <= 6000
    done.set()
    thread.join(1.0)
    assert not thread.is_alive()


def test_an_owner_under_it_carries_out_nothing_before_time_passes_and_everything_after():
    clock = VirtualTime(Steps(), PERIOD)
    done = []
    owner = Owner("device", lambda: clock.advance(0.004), lambda error: done.append(error), clock)
    owner.start()
    owner.post(lambda: done.append("posted"))
    assert done == []
    clock.advance(0.006)
    assert done == ["posted"]
    assert owner.ask(lambda: "answered") == "answered"
    owner.close()


class Echo:
    """Sends back its input."""

    def __init__(self):
        self.peers = []

    def connected(self, peer):
        self.peers.append(peer)

    def received(self, peer, chunk):
        peer.send(chunk.upper())

    def disconnected(self, peer):
        self.peers.remove(peer)

    def advance(self, now):
        pass


def test_a_pipe_carries_bytes_both_ways_and_its_faults_are_those_of_a_wire():
    clock = VirtualTime(Steps(), PERIOD)
    pipe = Pipe(Echo(), clock, latency=0.010)
    link = pipe.open()
    link.send(b"abc")
    assert link.receive(0.0) == b""
    before = clock.now()
    assert link.receive(1.0) == b"ABC"
    assert clock.now() - before == 0.010
    pipe.inject_fault("garbage")
    link.send(b"abc")
    assert link.receive(1.0) == bytes(byte ^ 0x5A for byte in b"ABC")
    pipe.inject_fault("lossy")
    link.send(b"abcdefghijklmn")
    assert link.receive(1.0) == b"BCDEFGIJKLMN"
    pipe.inject_fault("late")
    link.send(b"abc")
    assert link.receive(LATE) == b""
    assert link.receive(0.02) == b"ABC"
    pipe.inject_fault("silent")
    link.send(b"abc")
    assert link.receive(1.0) == b""
    pipe.clear_fault()
    link.send(b"abc")
    assert link.receive(1.0) == b"ABC"


def test_a_cut_pipe_breaks_its_connections_and_takes_new_ones_only_when_it_is_mended():
    clock = VirtualTime(Steps(), PERIOD)
    echo = Echo()
    pipe = Pipe(echo, clock)
    link = pipe.open()
    pipe.inject_fault("cut")
    assert echo.peers == []
    for use in (lambda: link.send(b"a"), lambda: link.receive(0.0), pipe.open):
        try:
            use()
        except ConnectionError:
            continue
        raise AssertionError("a cut wire carries")
    pipe.clear_fault()
    again = pipe.open()
    again.send(b"a")
    assert again.receive(0.01) == b"A"
