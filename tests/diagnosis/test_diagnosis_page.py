"""What is shown of a diagnosis: gain, residual, and the summary's words."""

from __future__ import annotations

import hashlib
import re
from dataclasses import replace
from pathlib import Path

import lxml.html
import numpy as np
import pytest
from markupsafe import Markup

from gimbal_pin import __version__
from gimbal_pin.checks import Fault
from gimbal_pin.diagnosis import LISTED, Diagnosis, Residual, Rival, diagnose
from gimbal_pin.effects import CAUSES, Backlash
from gimbal_pin.log import Log, write_log
from gimbal_pin.report import list_shown_joints, pages, show_diagnosis, tables, verdict
from gimbal_pin.report.summary import missed, to_do
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed
from tests.browsing import unpacked
from tests.command_line import Run
from tests.control.test_compensation import with_causes

TOGETHER = "only together; other sizes fit this log as well"

FEW = ("cogging", "cable-spring", "torque-ripple", "delay", "actuator-lag", "stribeck")


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig.load("turret")


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    """A turret whose tilt motor cogs."""
    model = with_causes(rig, "cogging:tilt:amplitude=0.04,harmonic=11")
    return prescribed(model, seconds=12.0, torque_noise=0.01, dt=0.004)


@pytest.fixture(scope="module")
def found(rig: Rig, log: Log) -> Diagnosis:
    few = {name: CAUSES[name] for name in FEW}
    return diagnose(rig, [log], few, rng=np.random.default_rng(0))


def test_nothing_is_promised_of_findings_that_a_spoilt_log_shows(found: Diagnosis) -> None:
    assert "What to do about it" in show_diagnosis(found).html
    fault = Fault("acceleration-noise", "tilt", "tilt: noise", (), 2.0, True, "record again")
    spoilt = replace(found, faults=(fault,))
    shown = show_diagnosis(spoilt).html
    assert "not to be acted on" in shown and "What to do about it" not in shown


def test_a_joint_that_is_simulated_worse_is_spoken_of(found: Diagnosis) -> None:
    for times in (2.0, 1.05):
        errors = {
            joint: x * (times if joint == "tilt" else 1)
            for joint, x in found.baseline["rollout_rmse"].items()
        }
        worse = show_diagnosis(replace(found, extended={**found.extended, "rollout_rmse": errors}))
        for page in (worse.to_text(), worse.html):
            assert ("tilt: the extended model simulates" in page) == (
                times > 1.1
            ) and "pan: the extended" not in page


def test_what_only_fits_together_says_so_on_every_page(found: Diagnosis) -> None:
    """Of figures none of which has a deviation neither terminal nor page lets one be taken for known."""
    (finding,) = found.findings
    loose = replace(
        finding, parameters=tuple(replace(p, std=float("nan")) for p in finding.parameters)
    )
    open_ = replace(found, findings=(loose,))
    assert (
        finding.sized
        and not finding.unsized
        and loose.unsized == loose.parameters
        and not loose.sized
    )
    for page, one in (
        (show_diagnosis(open_).to_text(), True),
        (show_diagnosis(found).to_text(), False),
    ):
        assert (TOGETHER in page) == one
    assert TOGETHER in show_diagnosis(open_).html and TOGETHER not in show_diagnosis(found).html


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_of_a_gap_whose_flanks_do_not_give_the_headline_holds_what_is_known(share: float) -> None:
    """Twice the gap and half the rotor pass the same torque on, and are told alike; the one alone is another."""
    one, same, other = (
        Backlash("tilt", 0.02 * k, 1e-3 / m, share) for k, m in ((1, 1), (2, 2), (2, 1))
    )
    command = np.cumsum(np.random.default_rng(0).standard_normal(4000)) / 50
    np.testing.assert_allclose(same.acting(command, 1e-3), one.acting(command, 1e-3), atol=1e-9)
    assert not np.allclose(other.acting(command, 1e-3), one.acting(command, 1e-3))
    assert one.says() == same.says() != other.says() and "2e-05 rad kg m^2" in one.says()


def test_the_page_holds_rivals_residual_and_gain(found: Diagnosis) -> None:
    page = lxml.html.fromstring(f"<div>{show_diagnosis(found).html}</div>")
    labels = [svg.get("aria-label") for svg in page.iter("svg")]
    assert [label.split()[0] for label in labels] == ["Drawing", "Held-out"]
    (table,) = [
        t
        for t in page.iter("table")
        if "in the place of cogging" in t.getparent().get("aria-label")
    ]
    shown = [row.findtext("th") for row in table.find("tbody")]
    assert "cogging" not in shown and len(set(shown)) == len(shown)
    assert shown == [rival.cause for rival in found.findings[0].rivals[:6]] and shown
    assert "cogging feed-forward by angle" in page.text_content()


def test_the_page_plays_the_log_beside_its_torque_by_both_models(
    rig: Rig, log: Log, found: Diagnosis
) -> None:
    """In one time: the scene's clock is that of the charts of torque, of the residual and of the log."""
    page = pages.describe_diagnosis(found).to_html()
    tree = lxml.html.fromstring(page)
    assert (
        len({one.get("data-clock") for one in tree.xpath("//iframe | //div[@class='charts']")}) == 1
    )
    left, torques, recorded = unpacked(page)
    labels = re.findall(
        r'"label": "([^"]*)"', tree.xpath("//div[@class='charts']")[1].get("data-charts")
    )
    assert len(left) == len(torques) == 2 * rig.n and len(recorded) == 2
    for residual, amplitude in zip(left[::2], left[1::2]):
        assert np.isnan(residual[-1]).any() and amplitude[0][-1] < 12 and np.all(amplitude[1:] > 0)
    for j in range(rig.n):
        (_, _, _, measured, model, extended), (*_, before, after) = torques[2 * j : 2 * j + 2]
        scale = 1e3 if "mN" in labels[2 * j + 1] else 1.0
        assert len(measured) > 400 and np.sqrt(np.nanmean(before**2)) >= np.sqrt(
            np.nanmean(after**2)
        )
        assert np.nanmax(np.abs(measured - extended)) == pytest.approx(
            np.nanmax(np.abs(after)) / scale, rel=1e-3
        )
        assert np.nanmax(np.abs(measured - model)) == pytest.approx(
            np.nanmax(np.abs(before)) / scale, rel=1e-3
        )


def test_rivals_are_the_nearest_of_each_other_name_in_order(found: Diagnosis) -> None:
    """Neither the cause itself at another joint, nor one name twice, nor one that is further off above a nearer one."""
    (finding,) = found.findings
    names = [rival.cause for rival in finding.rivals]
    assert names and len({finding.cause, *names}) == len(names) + 1
    assert np.all(np.diff([rival.log_odds for rival in finding.rivals]) <= 0)


def test_a_rival_is_ruled_out_where_the_others_hold_the_probability(found: Diagnosis) -> None:
    (finding,) = found.findings
    rivals = (Rival("delay", 1.0, 1.2), Rival("torque-ripple", 90.0, 6.1))
    table = tables.rivals(replace(finding, rivals=rivals))
    assert [Markup(row[-1]).striptags() for row in table.rows] == ["no", "yes"]


def test_every_finding_states_its_probability(found: Diagnosis) -> None:
    (finding,) = found.findings
    told = found.to_dict()
    assert finding.probability == told["findings"][0]["probability"] > 0.95 * LISTED
    assert told["causes"][0] == {
        "cause": "cogging",
        "joint": "tilt",
        "probability": finding.probability,
    }
    assert sum(each["probability"] for each in told["causes"]) <= LISTED * (1 + 1e-12)
    either = replace(finding, false_alarm=0.0, rivals=(Rival("delay", np.log(4.0), 1e6, "tilt"),))
    likely = replace(found, findings=(either,))
    assert [one["probability"] / LISTED for one in likely.to_dict()["causes"]] == pytest.approx(
        [0.8, 0.2]
    )
    for page in (show_diagnosis(likely).to_text(), show_diagnosis(likely).html):
        assert f"robability {80 * LISTED:.0f} %" in page


def test_the_page_holds_no_figure_that_is_none(found: Diagnosis) -> None:
    (finding,) = found.findings
    lost = replace(finding, gain={**finding.gain, "rollout_rmse_after": float("nan")})
    extended = {**found.extended, "rollout_rmse": dict.fromkeys(found.residual, float("nan"))}
    still = replace(found, findings=(lost,), extended=extended)
    page = lxml.html.fromstring(f"<div>{show_diagnosis(still).html}</div>").text_content()
    assert not re.search(r"\bnan\b", page) and "cannot be simulated" in page


def test_what_is_left_is_praised_nowhere(found: Diagnosis) -> None:
    """The state is that of the part that was fitted: the held-out error beside it may be another."""
    assert 'class="good"' not in str(tables.residual(found).__html__())


def test_the_table_of_gains_holds_the_figures_of_the_json(rig: Rig, found: Diagnosis) -> None:
    pan, tilt = list_shown_joints(rig)
    rows = tables.gain(found, (pan, tilt)).rows
    told = found.to_dict()
    for column, model in enumerate(("stated", "rubbing", "baseline", "extended"), start=1):
        assert tilt.text(told[model]["rollout_rmse"]["tilt"], digits=2) in str(rows[1][column])


def test_a_payload_that_a_finding_is_about_is_said_once(found: Diagnosis) -> None:
    """Its place by the stated mass would be a second answer to the same question; how to balance it is none."""
    about = replace(found, findings=(replace(found.findings[0], cause="payload-shift"),))
    place, *_ = found.given.lines
    apart = str(show_diagnosis(found))
    once = str(show_diagnosis(about))
    assert place in apart and place not in once
    assert found.given.advice and all(said in apart and said in once for said in found.given.advice)


def test_the_urdf_is_judged_beside_the_models(found: Diagnosis) -> None:
    """The rig is as its URDF says but for what was planted: no fit of bodies and friction comes nearer than 5 %."""
    for joint, error in found.stated["torque_rmse"].items():
        assert error < 1.05 * found.baseline["torque_rmse"][joint]
    worst = min(found.stated["fit_percent"], key=found.stated["fit_percent"].__getitem__)
    said = str(show_diagnosis(found))
    assert (
        found.held is not None
        and f"{found.held.band:g} Hz: URDF {tables.share_off(found.stated, worst)}" in said
    )


def test_the_headline_says_what_was_found(found: Diagnosis) -> None:
    assert missed(found) == "The rigid model misses cogging at tilt"
    (finding,) = found.findings
    either = replace(finding, blurred=("cable-spring",))
    assert missed(replace(found, findings=(either,))).endswith("cogging or cable-spring at tilt")
    left = {"pan": Residual("structured", 0.1, 9.0, 1.0)}
    assert "pan" in missed(replace(found, findings=(), residual=left))
    assert missed(None) == missed(replace(found, findings=())) == ""
    said = verdict(99.0, missed(found))
    assert "cogging at tilt" in said and "explains" not in said
    assert to_do(found, None) == ("Against cogging at tilt: cogging feed-forward by angle.",)
    either = replace(either, rivals=(), experiment="turn slowly")
    assert to_do(replace(found, findings=(either,)), None)[0].endswith(
        "cogging or cable-spring at tilt: turn slowly."
    )


def test_a_cause_that_is_left_open_is_nowhere_said_to_be_named(found: Diagnosis) -> None:
    """The verdict is named where any finding is; of another that is ambiguous it says that it is open."""
    finding = found.findings[0]
    either = replace(finding, joint="roll", blurred=("cable-spring",), experiment="it")
    mixed = replace(found, findings=(finding, either))
    first, sure = (
        show_diagnosis(one).to_text().splitlines()[0]
        for one in (mixed, replace(found, findings=(finding,)))
    )
    open_ = "cogging or cable-spring at roll"
    assert (
        open_ in first
        and open_ not in sure
        and all("cogging at tilt." in line for line in (first, sure))
    )


def test_a_diagnosis_has_a_page_of_its_own(
    run: Run, log: Log, found: Diagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stands beside the JSON and says what the terminal says."""
    monkeypatch.setattr("gimbal_pin.diagnosis.diagnose", lambda *_, **__: found)
    monkeypatch.setattr("gimbal_pin.diagnosis.planned", lambda found, **_: found)
    write_log(log, tmp_path / "log.csv")
    code, out, err = run("diagnose", "turret", tmp_path / "log.csv", "-o", tmp_path / "wrong")
    page = tmp_path / "wrong" / "report.html"
    assert code == 0 and f"report: {page}" in out, err
    tree = lxml.html.fromstring(page.read_text(encoding="utf-8"))
    (head,) = tree.xpath("//header/details")
    words = tree.text_content()
    assert head.xpath("summary/code")[0].text == "gimbal-pin diagnose turret log.csv -o wrong"
    assert (
        hashlib.sha256((tmp_path / "log.csv").read_bytes()).hexdigest()[:12] in head.text_content()
    )
    assert (
        f"gimbal_pin {__version__}" in head.text_content()
        and str(tmp_path) not in head.text_content()
    )
    links = [link.get("href") for link in head.iter("a")]
    assert "extended.yaml" in links and all((page.parent / name).is_file() for name in links)
    assert (
        all(one.sentence.partition(", ")[2][1:] in words for one in found.findings)
        and "Travel" in words
    )
    assert (tmp_path / "wrong" / "diagnosis.json").exists()
