"""Laws of deviations: repetitions with blocks of residuals, bodies' figures, and what the controller makes of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.signal import lfilter

from gimbal_pin.control import bounds
from gimbal_pin.dynamics import nominal, reduce_parameters
from gimbal_pin.identification import Identified, identify
from gimbal_pin.identification.bodies import compute_figures, estimate_bodies
from gimbal_pin.log import Array
from gimbal_pin.regression import (
    compute_deformation_root,
    find_likeliest_bodies,
    map_phi_to_base,
)
from gimbal_pin.rig import Rig, bundled_rigs, pseudo_inertia
from tests.bench_logs import EXACT, prescribed


@pytest.fixture(scope="module")
def found() -> Identified:
    rig = Rig.load("turret", "cinema")
    return identify(
        rig, [prescribed(nominal(rig), 2, 12.0, torque_noise=0.1)], filtering=EXACT, holdout="none"
    )


# --- bodies -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", bundled_rigs())
def test_figures_are_pinocchios(name: str) -> None:
    for phi in Rig.load(name, "cinema").phi.reshape(-1, 10):
        own = compute_figures(phi)
        body = pin.Inertia.FromDynamicParameters(phi)
        assert own[0] == pytest.approx(body.mass) and np.allclose(own[1:4], body.lever)
        assert np.allclose(own[4:], body.inertia[np.tril_indices(3)], atol=1e-12)


def test_intervals_of_bodies_hold_the_truth() -> None:
    """Bodies drawn as far from the URDF's as the trust says, base parameters with noise: 95 % are inside."""
    rig = Rig.load("turret", "cinema")
    trust = 0.1
    rng = np.random.default_rng(3)
    mixing = map_phi_to_base(rig, reduce_parameters(rig))
    root = trust * compute_deformation_root(rig.phi)
    hits = []
    std = 1e-3 * np.abs(mixing @ rig.phi) + 1e-5
    for _ in range(12):
        true = rig.phi + root @ rng.standard_normal(root.shape[1])
        if min(np.linalg.eigvalsh(pseudo_inertia(body))[0] for body in true.reshape(-1, 10)) <= 0:
            continue
        beta = mixing @ true + std * rng.standard_normal(len(std))
        phi = find_likeliest_bodies(rig.phi, mixing, beta, np.diag(std**2), trust)
        said = estimate_bodies(rig.links, rig.phi, phi, mixing, beta, np.diag(std**2), trust)
        for body, own in zip(said, true.reshape(-1, 10)):
            every = (body.mass, *body.com, *body.inertia)
            hits += [
                abs(f.value - x) <= 1.96 * f.std
                for f, x in zip(every, compute_figures(own))
                if f.std > 1e-12
            ]
    assert len(hits) > 150 and 0.90 < np.mean(hits) < 0.99


def test_what_the_log_shows_is_said_and_what_the_urdf_says_too(found: Identified) -> None:
    by_link = {body.link: body for body in found.bodies}
    assert set(by_link) == set(found.model.rig.links)
    written = found.to_dict()["bodies"]
    assert [body["link"] for body in written] == list(found.model.rig.links)
    first = found.bodies[0]
    last = found.bodies[-1]
    # Nothing that turns about one axis alone shows its mass; the camera's balance about its own axis shows.
    assert not first.mass.shown and any(figure.shown for figure in (*last.com, *last.inertia))
    assert first.mass.std == pytest.approx(found.trust * first.mass.value, rel=0.3)
    low, high = written[0]["mass"]["interval"]
    assert low < first.mass.value < high


# --- the controller's bound -------------------------------------------------------------------------------------------


def test_the_controller_draws_from_the_estimates_own_covariance(found: Identified) -> None:
    """Twice the believed, twice the bounds; and a repetition's covariance goes the same way."""
    model = found.model
    assert model.estimated is not None and model.estimated.covariance is found.estimate.covariance

    def scaled(factor: float) -> Array:
        assert model.estimated is not None
        known = replace(model.estimated, covariance=factor**2 * model.estimated.covariance)
        told = bounds(replace(model, estimated=known), np.random.default_rng(0))
        return np.array([told.alpha, told.phi])

    assert np.allclose(scaled(0.02), 2 * scaled(0.01), rtol=0.02)


def test_slow_noise_makes_the_controllers_bound_larger_than_fast_noise_of_its_size() -> None:
    rig = Rig.load("turret")
    log = prescribed(nominal(rig), 0, 15.0)
    rng = np.random.default_rng(0)
    told = []
    for pole in (0.0, 0.999):
        noise = lfilter(
            [np.sqrt(1 - pole**2)],
            [1.0, -pole],
            rng.standard_normal((len(log) + 5000, rig.n)),
            axis=0,
        )
        loud = replace(log, tau=np.asarray(log.tau) + 0.02 * noise[5000:])
        told.append(bounds(identify(rig, [loud], filtering=EXACT).model, np.random.default_rng(0)))
    assert told[1].phi > 3 * told[0].phi and told[1].alpha > 2 * told[0].alpha
