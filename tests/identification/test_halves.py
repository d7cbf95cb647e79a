"""Laws of two halves: of one rig they agree within chance, of two they do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.dynamics import nominal
from gimbal_pin.identification import Identified, compare_payload, identify, keep_held_out_accuracy
from gimbal_pin.regression import Filtering
from gimbal_pin.report import show_parameters
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed

SECONDS = 12.0


def mixed(rig: str, payloads: tuple[str, str]) -> Identified:
    """Identify a log of one motion with sensors' noise, its payload swapped half-way."""
    rigs = [Rig.load(rig, payload) for payload in payloads]
    rng = np.random.default_rng(0)
    first, second = (prescribed(nominal(one), 1, SECONDS) for one in rigs)
    tau = np.where(first.t[:, None] < SECONDS / 2, first.tau, second.tau)
    tau = tau + 0.02 * np.sqrt(np.mean(tau**2, axis=0)) * rng.standard_normal(tau.shape)
    v = np.asarray(first.v) + 1e-3 * rng.standard_normal(tau.shape)
    log = replace(first, v=v, tau=tau)
    return identify(rigs[0], [log], filtering=Filtering(alignment=0.0), examined="noisy")


def test_a_swapped_payload_is_suspected_and_none_where_none_was() -> None:
    same, swapped = (mixed("turret", ("cinema", second)) for second in ("cinema", "zoom-lens"))
    assert same.parting is not None and 0.0 < same.parting < 0.5 and not same.notes
    assert swapped.parting is not None and swapped.parting > 2.0
    assert swapped.to_dict()["halves_apart"] == swapped.parting
    assert swapped.is_of_two_rigs and not same.is_of_two_rigs
    told, of_two = (show_parameters(one, compare_payload(one)).to_text() for one in (same, swapped))
    assert "balance" in told and "balance" not in of_two


@pytest.mark.parametrize(("rig", "seed"), [("thesis", 3), ("handheld", 4), ("turret", 5)])
def test_a_log_almost_without_noise_is_of_one_rig(rig: str, seed: int) -> None:
    """Its halves differ by more than their deviations say, and by next to nothing of the torque.

    What differs is what the sensors add to the angles, which is not white.
    """
    loaded = Rig.load(rig)
    log = prescribed(nominal(loaded), seed, SECONDS)
    q = log.q + 2e-5 * np.sin(40 * log.q + seed) + 1e-6 * (log.t[:, None] - SECONDS / 2)
    found = identify(
        loaded, [replace(log, q=q)], filtering=Filtering(alignment=0.0), examined="noisy"
    )
    assert found.parting is not None and not found.is_of_two_rigs and not found.notes


def test_a_refit_learns_from_all_and_is_judged_without_what_it_was_held_out() -> None:
    rig = Rig.load("turret")
    options = Filtering(alignment=0.0)
    logs = [prescribed(nominal(rig), seed, 8.0, torque_noise=0.05) for seed in (1, 2)]
    held, everything = (
        identify(rig, logs, filtering=options, holdout=how) for how in (None, "none")
    )
    final = keep_held_out_accuracy(held, everything)
    np.testing.assert_array_equal(final.estimate.theta, everything.estimate.theta)
    assert (
        final.held_out == held.held_out
        and final.held_out is not None
        and "all data" in final.notes[-1]
    )
    assert np.median(final.estimate.std / held.estimate.std) < 0.9
    said = "prescribed 2 only judged the others and taught nothing; --refit learns from all"
    assert said in held.notes and said not in final.notes
