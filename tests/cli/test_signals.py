from __future__ import annotations

import ctypes
import signal
import sys
import time
import weakref

import pytest

from dqreg.cli.signals import PoliteSignals, Signals

NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
RAISED = {signal.SIGINT: KeyboardInterrupt, signal.SIGTERM: SystemExit, signal.SIGHUP: SystemExit}


@pytest.fixture(autouse=True)
def listening():
    # Jobs in the background are started with Ctrl-C ignored, and so may be this run of the tests.
    before = {number: signal.signal(number, signal.default_int_handler) for number in NUMBERS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def bad_moments(tmp_path, monkeypatch):
    """Places at which an exception is swallowed, printed, or taken for damage; each sends a signal and goes on."""
    (tmp_path / "dqreg_bad_moment.py").write_text(
        "import signal\ntry:\n    signal.raise_signal({number})\n"
        "except BaseException:\n    raise ImportError\nwhole = True\n"
    )
    monkeypatch.syspath_prepend(tmp_path)

    class Kept:
        def __init__(self, act):
            self.act = act

        def __del__(self):
            self.act()

    def importing(number):
        path = tmp_path / "dqreg_bad_moment.py"
        path.write_text(path.read_text().format(number=int(number)))
        monkeypatch.delitem(sys.modules, "dqreg_bad_moment", raising=False)
        import dqreg_bad_moment

        return dqreg_bad_moment.whole

    def finalising(number):
        Kept(lambda: signal.raise_signal(number))
        return True

    def dying(number):
        class Thing:
            pass

        thing, done = Thing(), []
        weakref.finalize(thing, lambda: (signal.raise_signal(number), done.append(True)))
        del thing
        return done == [True]

    def calling_back(number):
        # As the compiler calls Python while it loads what it has compiled: ctypes prints what is raised and goes on.
        done = []
        names = {"act": lambda: (signal.raise_signal(number), done.append(True))}
        exec(compile("def notify():\n    act()\n", str(tmp_path / "llvmlite" / "binding.py"), "exec"), names)
        ctypes.CFUNCTYPE(None)(names["notify"])()
        return done == [True]

    return {
        "an import": importing,
        "a finaliser": finalising,
        "a weak reference": dying,
        "a callback of the compiler": calling_back,
    }


@pytest.mark.parametrize("number", NUMBERS)
@pytest.mark.parametrize("place", ["an import", "a finaliser", "a weak reference", "a callback of the compiler"])
def test_at_a_bad_moment_it_waits_for_a_good_one(bad_moments, place, number, capfd):
    finished, signals = [], Signals()

    def work():
        finished.append(bad_moments[place](number))
        time.sleep(10.0)
        finished.append("lost")

    with pytest.raises(RAISED[number]), signals:
        work()
    assert finished == [True]
    assert signals.number == number
    assert capfd.readouterr().err == ""


def test_it_is_raised_at_once_elsewhere_and_the_handlers_come_back():
    before = [signal.getsignal(number) for number in NUMBERS]
    for number in NUMBERS:
        with pytest.raises(RAISED[number]) as stop, Signals():
            signal.raise_signal(number)
        assert number == signal.SIGINT or stop.value.code == 128 + number
    assert [signal.getsignal(number) for number in NUMBERS] == before


def test_what_the_caller_has_had_ignored_stays_ignored():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with Signals() as signals:
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        signal.raise_signal(signal.SIGINT)
    assert signals.number == 0
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def test_a_polite_stop_is_noted_once_and_raised_the_second_time(capfd):
    with PoliteSignals() as stop:
        stop.polite = True
        signal.raise_signal(signal.SIGTERM)
        assert stop.asked()
        with pytest.raises(SystemExit) as end:
            signal.raise_signal(signal.SIGINT)
    assert end.value.code == 128 + signal.SIGINT
    assert capfd.readouterr().err.splitlines() == [
        "dqreg: stopping: what is done is kept; once more to stop at once", "dqreg: stopped at once",
    ]  # fmt: skip
    with pytest.raises(SystemExit), PoliteSignals():
        signal.raise_signal(signal.SIGINT)
    assert capfd.readouterr().err == "dqreg: stopped; nothing was written\n"
