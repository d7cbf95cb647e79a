"""Laws of how late a drive must be to be found: as told, less of it in a wider band, and none where none is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gimbal_pin import text
from gimbal_pin.diagnosis import BAND, Diagnosis, diagnose
from gimbal_pin.diagnosis.lateness import Late, Timing
from gimbal_pin.diagnosis.state import State, without
from gimbal_pin.diagnosis.timing import late, wider, worth_telling
from gimbal_pin.diagnosis.uncertainty import slopes
from gimbal_pin.diagnosis.walking import walk, walked
from gimbal_pin.effects import CAUSES
from gimbal_pin.effects.delay import Delay
from gimbal_pin.log import Array, Log
from gimbal_pin.model import nominal
from gimbal_pin.rig import Rig

RIG = Rig.load("turret")
DT, SECONDS = 0.004, 20.0
TIMELY = {name: CAUSES[name] for name in ("delay", "actuator-lag")}


@cache
def recorded(time: float, seed: int = 0) -> Log:
    """Slow sweeps with a little of what is fast, the pan motor's torque commanded `time` s before it acts."""
    t = DT * np.arange(round(SECONDS / DT))
    rng = np.random.default_rng(seed)
    w = 2 * np.pi * np.array([0.11, 0.17, 0.31, 4.3, 9.7, 16.0, 23.0])
    size = np.array([0.5, 0.4, 0.3, 4e-4, 1e-4, 6e-5, 4e-5])[:, None]
    phase = rng.uniform(0, 2 * np.pi, (len(w), RIG.n))

    def motion(at):  # type: ignore[no-untyped-def]
        turn = w[:, None, None] * at[:, None] + phase[:, None]
        q, v = np.sum(size[:, None] * np.sin(turn), axis=0), np.sum((size * w[:, None])[:, None] * np.cos(turn), axis=0)
        return q, v, -np.sum((size * w[:, None] ** 2)[:, None] * np.sin(turn), axis=0)

    q, v, a = motion(t)
    model = nominal(RIG)
    tau = model.inverse(q, v, a)
    tau[:, 0] = model.inverse(*motion(t + time))[:, 0]
    noise = [std * rng.standard_normal(q.shape) for std in (1e-5, 2e-3, 0.03)]
    return Log("fast", RIG.joints, t, q + noise[0], v + noise[1], tau + noise[2])


@cache
def said(time: float, cutoff: float = BAND.cutoff) -> Diagnosis:
    band = replace(BAND, cutoff=cutoff, alignment=0.0)
    return diagnose(RIG, [recorded(time)], TIMELY, rng=np.random.default_rng(0), filtering=band)


def least(found: Diagnosis) -> float:
    """The least delay of pan that would be found, s."""
    assert found.state is not None
    delays = [one for one in Delay.tried("pan", found.state.problem.evidence.seen[0]) if isinstance(one, Delay)]
    return late(found.state, delays, 1e-5).least


@pytest.mark.parametrize("cutoff", [12.0, 30.0])
def test_a_delay_is_found_from_what_is_told_on(cutoff: float) -> None:
    told = least(said(0.0, cutoff))
    assert said(0.0, cutoff).verdict == "nothing"
    assert not said(0.6 * told, cutoff).findings
    found = said(1.5 * told, cutoff).findings
    assert found and found[0].joint == "pan" and found[0].cause in TIMELY


def test_a_wider_band_shows_less_of_a_delay_and_the_one_that_is_there() -> None:
    """What the wider band would find is what diagnosing in it finds."""
    time = 0.5 * least(said(0.0))
    narrow = said(time)
    assert not narrow.findings and narrow.timing is not None
    assert f"--cutoff {narrow.timing.cutoff:g}" in text.diagnosis(narrow, {})
    assert (
        text.diagnosis(narrow, {}, "CALL").splitlines()[1].startswith(f"next: CALL --cutoff {narrow.timing.cutoff:g} ")
    )
    shown = narrow.timing.joints["pan"][1].shown
    found = said(time, narrow.timing.cutoff).findings[0]
    assert shown == pytest.approx(time, rel=0.1) and found.parameters[0].value == pytest.approx(shown, rel=0.05)


def test_where_no_drive_is_late_none_shows() -> None:
    timing = said(0.0).timing
    assert timing is None or all(there.shown == 0 for _, there in timing.joints.values())


def test_the_wider_band_is_one_that_the_log_allows() -> None:
    log = recorded(0.0)
    assert wider([log], BAND) == 30.0
    assert wider([log.part(slice(None, None, 2))], BAND) == 25.0


def test_nothing_is_told_of_a_delay_that_is_found_or_that_no_loop_feels() -> None:
    """A wider band is spoken of where it shows another delay, or much less of one than this band."""
    found, other = Late(0.002, 0.006), Late(0.001, 0.009)
    assert (
        not worth_telling(found, found, DT) and worth_telling(found, other, DT) and worth_telling(Late(0.01), found, DT)
    )
    assert worth_telling(Late(0.01), Late(0.004), DT) and not worth_telling(Late(0.003), Late(0.001), DT)
    assert not worth_telling(Late(0.01), Late(0.006), DT)


def test_figures_without_an_end_are_null_in_json_and_words_in_text() -> None:
    timing = Timing(30.0, {"pan": (Late(np.inf), Late(0.003, 0.006))})
    assert timing.to_dict()["joints"]["pan"] == {"least": None, "least_there": 0.003, "shown_there": 0.006}
    assert "inf" not in timing.sentence and "6 ms" in timing.sentence


def test_a_band_that_shows_no_delay_is_not_asked_for() -> None:
    assert Timing(30.0, {"pan": (Late(0.01), Late(0.003))}).next("CALL") == ()


@pytest.mark.parametrize("size", [0.0, 0.3])
def test_what_rings_above_the_band_is_pointed_at(size: float) -> None:
    """A torque of 23 Hz is nothing at 12 Hz; the call that looks there comes first, and only where it rings."""
    log = recorded(0.0)
    rung = size * np.sin(2 * np.pi * 23.0 * log.t) * np.sin(2 * np.pi * 0.3 * log.t)
    band = replace(BAND, alignment=0.0)
    ringing = replace(log, tau=np.asarray(log.tau) + np.outer(rung, [0.0, 1.0]))
    found = diagnose(RIG, [ringing], TIMELY, rng=np.random.default_rng(0), filtering=band)
    assert found.verdict == "nothing"
    calls = [] if found.timing is None else [*found.timing.next("CALL")]
    assert [call.startswith("CALL --cutoff 30 (there more than noise is left at tilt") for call in calls] == [True] * (
        size > 0
    )
    if found.timing is not None:
        assert found.timing.to_dict()["more"] == ["tilt"] * (size > 0)


@cache
def delayed() -> tuple[State, Array, Array]:
    """What is found of a late drive, its slope by the time, and the part of that in the upper half of the band."""
    state = said(0.004, 30.0).state
    assert state is not None
    cause = state.causes[0]
    slope = slopes(state, without(state, cause), cause)[:, 0, 0]
    spectrum = np.fft.rfft(slope)
    spectrum[: len(spectrum) // 2] = 0.0
    return state, slope, np.fft.irfft(spectrum, len(slope))


def leaving(state: State, residual: Array) -> State:
    """The state, had its fit left this at pan, in units of the noise."""
    left = state.fit.residual.copy()
    left[:: RIG.n] = residual * state.fit.scale[0]
    return replace(state, fit=replace(state.fit, residual=left))


def test_by_chance_a_drives_time_walks_with_the_band_once_in_a_hundred() -> None:
    state, slope, _ = delayed()
    rng = np.random.default_rng(0)
    walks = [walk(leaving(state, rng.standard_normal(len(slope))), 0, slope) for _ in range(300)]
    assert np.mean([far > 0 for far in walks]) < 0.03


def test_what_moves_a_drives_time_by_the_fast_part_of_the_band_widens_it() -> None:
    """By as much as it moves it, give or take what the slow part tells by itself (0.9 ms); nothing does nothing."""
    state, slope, fast = delayed()
    noise = np.random.default_rng(1).standard_normal(len(slope))
    for far in (-5e-3, 5e-3):
        assert walk(leaving(state, noise + far * fast), 0, slope) == pytest.approx(abs(far), abs=2e-3)
    shown = said(0.004, 30.0).findings[0].parameters
    assert walked(state, state.causes[0], shown) == shown
    assert walked(leaving(state, noise + 5e-3 * fast), state.causes[0], shown)[0].std > 2e-3
