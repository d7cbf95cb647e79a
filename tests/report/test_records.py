"""Every record shows itself: the same numbers in dict, table, terminal, notebook and page, and none of it alters it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import lxml.html
import numpy as np
import pytest

import gimbal_pin
from gimbal_pin import GimbalPinError, Log, Rig
from gimbal_pin.control import Tuning, judge_controllers, pair_rivals
from gimbal_pin.diagnosis import Diagnosis
from gimbal_pin.dynamics import compute_base
from gimbal_pin.excitation import predict_estimate
from gimbal_pin.identification import Identified, identify_several
from gimbal_pin.identification.model_file import read_model
from gimbal_pin.log import to_json
from gimbal_pin.report import describe_record
from gimbal_pin.rig import Record
from tests.bench_logs import fourier, prescribed
from tests.rigs import bundled, spelled

MARKED = """<robot name="&lt;i&gt;rig"><link name="base"/><link name="&lt;u&gt;arm"><inertial><origin xyz="0.1 0 0.02"/>
  <mass value="0.8"/><inertia ixx="0.001" iyy="0.002" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="&lt;em&gt;" type="revolute"><parent link="base"/><child link="&lt;u&gt;arm"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="3" velocity="4"/><dynamics friction="0.04" damping="0.02"/></joint></robot>"""
"""A rig whose names are elements of HTML."""


@cache
def log_of(rig: Rig) -> Log:
    return prescribed(gimbal_pin.nominal(rig), seconds=12.0, torque_noise=0.01)


@cache
def identified(rig: Rig) -> Identified:
    return gimbal_pin.identify(rig, [log_of(rig)])


@cache
def diagnosed(rig: Rig) -> Diagnosis:
    return gimbal_pin.diagnose(rig, [log_of(rig)], rng=0)


@cache
def tuned(rig: Rig) -> Tuning:
    return gimbal_pin.tune(identified(rig).model, disk_margin=1.0)


def spoilt(rig: Rig) -> Diagnosis:
    """The verdict is *data*, and nothing else is known."""
    log = log_of(rig)
    found = gimbal_pin.diagnose(
        rig, [replace(log, tau=np.roll(np.asarray(log.tau), 200, axis=0))], rng=0
    )
    assert found.verdict == "data" and found.held is None
    return found


RECORDS: dict[str, Callable[[Rig], Record]] = {
    "Identified": identified,
    "Identified without its logs": lambda rig: replace(identified(rig), data=()),
    "Diagnosis": diagnosed,
    "Diagnosis of spoilt logs": spoilt,
    "Tuning": lambda rig: tuned(rig),
    "Judgement": lambda rig: judge_controllers(
        identified(rig).model, pair_rivals(tuned(rig).stored), rng=0, plants=2
    ),
    "Tracking": lambda rig: gimbal_pin.track(
        identified(rig).model, pair_rivals(tuned(rig).stored), rng=0, seconds=0.7, one_by_one=False
    ),
    "Excitation": lambda rig: gimbal_pin.excite(rig, seconds=2, starts=1, rng=0),
    "ExpectedEstimate": lambda rig: predict_estimate(
        gimbal_pin.nominal(rig), fourier(rig, 0, 8.0), rng=0
    ),
    "Rehearsal": lambda rig: gimbal_pin.rehearse(rig, fourier(rig, 0, 8.0), rng=0),
    "Base": compute_base,
    "Checked": gimbal_pin.check,
    "Several": lambda rig: identify_several({"one": rig}, {"one": [log_of(rig)]}),
    "Model": lambda rig: identified(rig).model,
    "Rig": lambda rig: rig,
    "Log": lambda rig: log_of(rig).part(slice(0, 500)),
}
"""What is shown → how it is found of a rig."""


@pytest.fixture(scope="module", params=RECORDS)
def record(request: pytest.FixtureRequest) -> Record:
    return RECORDS[request.param](bundled("turret"))


def numbers(text: str) -> set[str]:
    return set(re.findall(r"\d+(?:\.\d+)?", text))


def flat(value: Any, name: str = "") -> dict[str, Any]:
    """A tree of dictionaries as one, the names joined by dots."""
    if not isinstance(value, dict) or not value:
        return {name: value}
    inside = (flat(one, f"{name}.{key}".lstrip(".")) for key, one in value.items())
    return {key: one for part in inside for key, one in part.items()}


def test_a_record_is_a_line_at_a_prompt(record: Record) -> None:
    assert "\n" not in repr(record) and 10 < len(repr(record)) <= 400


def test_the_table_holds_what_the_dict_holds(record: Record) -> None:
    rows = record.to_dict()[record.ROWS]
    if isinstance(rows, dict):
        rows = [{"name": name, **row} for name, row in rows.items()]
    frame = record.to_frame()
    assert len(frame) == len(rows)
    for row, cells in zip(rows, frame.to_dict("records")):
        for name, value in flat(row).items():
            same = cells.get(name) == value or (value is None and cells[name] != cells[name])
            assert same or (value == {} and name not in cells), name


def test_a_notebook_and_a_page_show_every_number_of_the_terminal(
    record: Record, tmp_path: Path
) -> None:
    said = describe_record(record).to_text()
    shown = lxml.html.fromstring(record._repr_html_())
    assert numbers(said) and numbers(said) <= numbers(shown.text_content())
    record.report(tmp_path / "page.html")
    page = lxml.html.parse(tmp_path / "page.html").getroot()
    assert numbers(said) <= numbers(page.find("body").text_content())
    titles, every = ([one.text for one in tree.iter("h2")] for tree in (shown, page))
    assert titles == every[: len(titles)]


def test_showing_a_record_does_not_change_it(record: Record, tmp_path: Path) -> None:
    before = (
        to_json(record.to_dict()),
        {one.name: id(getattr(record, one.name)) for one in fields(record)},
    )  # type: ignore[arg-type]
    first = record._repr_html_()
    record.report(tmp_path / "page.html")
    assert record._repr_html_() == first
    assert before == (
        to_json(record.to_dict()),
        {name: id(getattr(record, name)) for name in before[1]},
    )
    assert json.loads(before[0])


def test_a_record_draws_the_first_figure_of_its_page_or_says_that_there_is_none(
    record: Record, tmp_path: Path
) -> None:
    if "<svg" in describe_record(record).to_html():
        for suffix in ("png", "svg"):
            record.plot().savefig(tmp_path / f"figure.{suffix}")
        assert "#0a0b0" not in (tmp_path / "figure.svg").read_text(encoding="utf-8")
    else:
        with pytest.raises(GimbalPinError, match="plot: has nothing to draw of"):
            record.plot()


def test_print_shows_what_a_terminal_shows_unless_a_record_has_a_text_of_its_own(
    record: Record,
) -> None:
    if "__str__" not in vars(type(record)):
        assert str(record) == describe_record(record).to_text() and "\n" not in repr(record)
    assert str(record) and len(repr(record)) <= 400


def test_results_of_logs_are_saved_as_their_verbs_write_them(tmp_path: Path) -> None:
    rig = bundled("turret")
    for name in ("Identified", "Diagnosis"):
        found: Any = RECORDS[name](rig)
        model = found.model if name == "Identified" else found.after
        found.save(tmp_path / "model.yaml")
        again = read_model(tmp_path / "model.yaml", rig)
        assert again.estimated is not None and model.estimated is not None
        np.testing.assert_allclose(again.estimated.theta, model.estimated.theta)
        np.testing.assert_allclose(again.estimated.covariance, model.estimated.covariance)


def test_a_scene_stands_in_a_frame_and_in_a_file(tmp_path: Path) -> None:
    rig = bundled("turret")
    shown = gimbal_pin.animate(rig, log_of(rig).part(slice(0, 500)))
    (frame,) = lxml.html.fromstring(shown._repr_html_()).xpath("//iframe")
    assert frame.get("srcdoc") == shown.page and "\n" not in repr(shown)
    moving = {
        name for name, make in RECORDS.items() if describe_record(make(rig)).scene is not None
    }
    assert moving >= {"Identified", "Diagnosis", "Tracking", "Excitation"}
    assert (
        RECORDS["Excitation"](rig).animate(tmp_path / "motion.html").page
        == (tmp_path / "motion.html").read_text()
    )
    with pytest.raises(GimbalPinError, match="animate: has nothing that moves"):
        tuned(rig).animate()


def test_draws_for_arviz_have_the_estimate_s_mean_and_covariance() -> None:
    pytest.importorskip("arviz")
    found = identified(bundled("turret"))
    drawn = found.to_arviz(4000, rng=0).posterior
    table = np.array([drawn[name].to_numpy().ravel() for name in found.names])
    error = (table.mean(axis=1) - found.estimate.theta) / found.estimate.std
    assert np.abs(error).max() < 5 / 4000**0.5
    correlation = found.estimate.covariance / np.outer(found.estimate.std, found.estimate.std)
    np.testing.assert_allclose(np.corrcoef(table), correlation, atol=0.08)


@pytest.mark.parametrize("name", RECORDS)
def test_names_that_are_elements_stay_text(name: str) -> None:
    shown = RECORDS[name](spelled(MARKED))._repr_html_()
    tree = lxml.html.fromstring(shown)
    assert "<em>" in tree.text_content() and not [*tree.iter("em"), *tree.iter("u")]
