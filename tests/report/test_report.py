"""The report: what it says is what the results say, nothing in it can break the page, and a real browser shows it."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from io import BytesIO
from math import nan
from pathlib import Path
from typing import Any

import lxml.html
import matplotlib
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from markupsafe import Markup
from PIL import Image

from gimbal_pin.control import (
    RIVAL,
    Judgement,
    Tracking,
    Tuning,
    judge_controllers,
    pair_rivals,
    track,
    tune,
)
from gimbal_pin.diagnosis import diagnose
from gimbal_pin.dynamics import Model, Sensors, check, nominal
from gimbal_pin.effects import CAUSES, Sample, TorqueTable
from gimbal_pin.identification import Identified, compare_payload, identify
from gimbal_pin.log import Log, to_json
from gimbal_pin.regression import Filtering
from gimbal_pin.report import (
    FILES,
    Auto,
    Document,
    Origin,
    RigDrawing,
    Section,
    Table,
    describe_outcome,
    describe_record,
    elements,
    evaluate,
    join,
    list_shown_joints,
    plots,
    show_check,
    show_controller,
    show_diagnosis,
    show_judgement,
    show_logs,
    show_parameters,
    show_rig,
    show_torque,
    show_tracking,
    summary,
    tables,
    verdict,
)
from gimbal_pin.report import format as numbers
from gimbal_pin.report.view import record
from gimbal_pin.rig import Rig, to_sliding
from tests.browsing import OPEN, WIDER, audit, embedded, media, needs_browser, pause, visit, wide
from tests.rigs import spelled

WRONG = "What the simulation gets wrong"
SIMULATED = "The controllers were simulated, their steps on {}, and not run on the gimbal."

EVIL = "<script>alert(1)</script> & \"$x$ _{a}$ 'b'"
"""A name that breaks pages, attributes and formulas that do not escape it."""

SLIDER = """<robot name="slider"><link name="base"/>
  <link name="sledge"><inertial><origin xyz="0.02 0 0.01"/><mass value="0.8"/>
    <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="slide" type="prismatic"><parent link="base"/><child link="sledge"/><axis xyz="0 0 1"/>
    <limit lower="-0.2" upper="0.2" effort="30" velocity="1"/>
    <dynamics friction="0.4" damping="1.5"/></joint></robot>"""


@dataclass(frozen=True)
class Walk:
    """Every result of one walk through the house."""

    rig: Rig
    logs: tuple[Log, ...]
    found: Identified
    tunings: dict[str, Tuning]
    result: Tracking
    judged: Judgement


def bench(
    rig: Rig, seconds: float = 24.0, rate: float = 250.0, seed: int = 0, name: str = "bench.csv"
) -> Log:
    """Return a log whose torque is the nominal model's on a smooth motion, with white noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, seconds, 1 / rate)[:, None]
    q, v, a = np.zeros((3, len(t), rig.n))
    half = np.array([min(limit.upper, 1.0) - max(limit.lower, -1.0) for limit in rig.limits]) / 4
    for k, w in enumerate((1.1, 2.3, 3.7)):
        w = w * (1 + 0.13 * np.arange(rig.n))
        phase = rng.uniform(0, 6, rig.n)
        q, v, a = (
            x + half / (k + 1) * w**d * np.sin(w * t + phase + d * np.pi / 2)
            for d, x in enumerate((q, v, a))
        )
    tau = nominal(rig).inverse(q, v, a)
    tau = tau + 0.01 * tau.std(axis=0) * rng.standard_normal(tau.shape)
    return Log(name, rig.joints, t[:, 0], q, v, tau, payload=rig.payload)


def walked(rig: Rig, name: str = "bench.csv") -> Walk:
    """Return the results of a short walk."""
    logs = (bench(rig, name=name),)
    found = identify(rig, logs, filtering=Filtering(8.0))
    tunings = {kind: tune(found.model, kind=kind, dt=0.002) for kind in ("computed-torque", "pid")}
    laws = pair_rivals(tunings["computed-torque"].stored)
    judged = judge_controllers(found.model, laws, rng=0, plants=2, delay=0.002)
    exact = Sensors.exact(rig.n)
    result = track(found.model, laws, rng=np.random.default_rng(0), seconds=0.7, sensors=exact)
    return Walk(rig, logs, found, tunings, result, judged)


@pytest.fixture(scope="module")
def walk() -> Walk:
    """The two-axis rig."""
    return walked(Rig.load("turret"))


@pytest.fixture(scope="module")
def slid() -> Walk:
    """A rig of one joint that slides, without a camera."""
    return walked(spelled(SLIDER))


@pytest.fixture(scope="module")
def animation(walk: Walk) -> str:
    """The recorded steps."""
    return record(walk.rig, walk.result.of("all-axes", "computed-torque").log)


@pytest.fixture(scope="module")
def page(walk: Walk) -> str:
    """The whole report."""
    return whole(walk)


def whole(walk: Walk, **more: str) -> str:
    """Return the report of a walk."""
    return describe_record(gather(walk, **more)).to_html()


def gather(walk: Walk, why: str = "", **more: str) -> Auto:
    """Return the results of a walk as `auto` returns them."""
    payload = compare_payload(walk.found)
    tuned = walk.tunings["computed-torque"]
    head = summary(
        walk.rig, walk.found, tuned, walk.result, walk.logs, payload=payload, not_held=why, **more
    )
    files = {what: Path("out") / name for what, name in FILES.items()}
    tuning = walk.tunings["computed-torque"]
    moved = walk.result.of("all-axes", "computed-torque").log
    steps = walk.found, None, walk.found.model, tuning, walk.result, walk.judged, moved, files
    return Auto(*steps, "the identified model", head, payload, why=why, **more)


def test_what_could_not_be_diagnosed_says_why(walk: Walk, page: str) -> None:
    why = "turret.csv: its torque has nothing to do with the motion; check its column"
    said = whole(walk, undiagnosed=why)
    assert why in said and why not in page and WRONG in said


def parsed(text: str) -> Any:
    """Return a page, or a part of one, as a tree."""
    return lxml.html.fromstring(text)


def cells(section: Section, label: str) -> list[list[str]]:
    """Return the rows of the table of a label as texts."""
    (found,) = [
        table
        for table in parsed(f"<div>{section.html}</div>").iter("table")
        if label in (table.getparent().get("aria-label"), table.findtext("caption"))
    ]
    return [[cell.text_content().strip() for cell in row] for row in found.find("tbody")]


# -- numbers -----------------------------------------------------------------------------------------------------------


def value_of(text: str) -> float:
    """Return what a written number says."""
    plain = text.replace("−", "-").replace("± ", "")
    mantissa, _, power = plain.partition("·10")
    return float(mantissa) * 10.0 ** int(
        (power or "0").translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
    )


@given(st.floats(-1e12, 1e12, allow_subnormal=False), st.integers(1, 6))
@example(9.996e-5, 3)
@example(0.09999, 2)
@example(999999.6, 3)
def test_figures_keep_their_significant_digits(value: float, digits: int) -> None:
    text = numbers.figures(value, digits)
    assert abs(value_of(text) - value) <= 0.5000001 * 10.0 ** (1 - digits) * abs(value)
    assert not text.startswith("−0") or value_of(text) != 0


@given(st.floats(-1e6, 1e6, allow_subnormal=False), st.floats(1e-12, 1e6))
@example(0.0, 3e-9)
@example(1.0, 0.0996)
@example(99.96, 9.996)
def test_an_interval_is_written_to_its_second_digit(value: float, half: float) -> None:
    centre, width = numbers.interval(value, half)
    assert abs(value_of(width) - half) <= 0.051 * half
    assert abs(value_of(centre) - value) <= 0.051 * half + 1e-15 * abs(value)


def test_what_has_no_value_is_a_dash_and_what_has_no_bound_is_infinite() -> None:
    assert numbers.figures(nan) == numbers.figures(None) == numbers.DASH
    assert numbers.figures(-np.inf) == "−∞" and numbers.interval(1.0, np.inf)[1] == "± ∞"
    assert [numbers.percent(x) for x in (99.97, 100.0, 99.94, nan)] == [
        "> 99.9 %",
        "100.0 %",
        "99.9 %",
        numbers.DASH,
    ]
    assert (
        numbers.format_range([nan, 2.0, 1.0]) == "1.0 to 2.0"
        and numbers.format_range([3.0, 3.001]) == "3.0"
    )
    assert numbers.listed("abc") == "a, b and c"


# -- parts of a page ---------------------------------------------------------------------------------------------------

TEXTS = st.text(
    st.characters(min_codepoint=32, blacklist_categories=("Cs", "Cc", "Co", "Cn")),
    min_size=1,
    max_size=40,
)


@given(TEXTS)
@example(EVIL)
def test_any_text_comes_out_of_the_page_as_it_went_in(text: str) -> None:
    card = elements.Card(text, text, text)
    parts = [
        elements.paragraph(text),
        Table([text, "b"], [[text, elements.toned(text, "good")]], caption=text),
        elements.cards([card]),
        elements.bullets([text]),
        elements.figure(Markup("<svg></svg>"), text),
        elements.bar(0.5, text),
    ]
    page = Document(text, text, [Section(text, parts, text)]).to_html()
    tree = parsed(page)
    assert {element.tag for element in tree.iter() if isinstance(element.tag, str)} <= {
        *(
            "html",
            "head",
            "meta",
            "link",
            "title",
            "style",
            "body",
            "div",
            "nav",
            "ul",
            "li",
            "a",
            "header",
            "h1",
            "p",
        ),
        *(
            "main",
            "section",
            "h2",
            "table",
            "caption",
            "thead",
            "tbody",
            "tr",
            "th",
            "td",
            "span",
            "strong",
            "small",
        ),
        *("figure", "figcaption", "svg", "i", "b"),
    }
    for path in (
        "//h1",
        "//h2",
        "//caption",
        "//td/span",
        "//main//li",
        "//figcaption",
        "//strong",
    ):
        (found,) = tree.xpath(path)
        assert found.text_content().split() == text.split()


def test_what_is_folded_is_said_in_the_terminal_but_for_pictures() -> None:
    """Of a picture, which needs a page, not even the line that opens it."""
    picture = plots.Drawing(lambda: plots.panels(1, 1, 2.0)[0], "alt", "caption")
    for parts, said in (((picture,), ""), ((picture, elements.paragraph("a")), "\nOpens\na")):
        assert Section("x", [elements.folded("Opens", *parts)]).to_text(detailed=True) == said
        assert Section("x", [elements.folded("Opens", *parts)]).to_text() == ""


@given(
    st.lists(
        st.one_of(TEXTS, st.sampled_from(["Data", "data", "data-2", "Data 2", "<>"])), max_size=8
    )
)
def test_every_section_has_an_address_of_its_own(titles: list[str]) -> None:
    page = parsed(
        Document("page", "", [Section(title, [Markup("")]) for title in titles]).to_html()
    )
    found = page.xpath("//main/section/@id")
    assert len(set(found)) == len(found) == len(titles)
    assert all(re.fullmatch(r"[a-z0-9-]+", anchor) for anchor in found)


@given(st.integers(3, 3000), st.integers(0, 2**32 - 1), st.integers(0, 5))
def test_a_thinned_curve_keeps_its_peaks_and_its_gaps(count: int, seed: int, holes: int) -> None:
    rng = np.random.default_rng(seed)
    t = np.arange(float(count))
    values = rng.standard_normal(count)
    values[rng.integers(0, count, holes)] = np.nan
    if np.isnan(values).all():
        return
    x, y = plots.thinned(t, values, 300)
    assert len(x) <= 300 and np.all(np.diff(x) > 0)
    assert np.nanmin(y) == np.nanmin(values) and np.nanmax(y) == np.nanmax(values)
    assert np.array_equal(y, values[x.astype(int)], equal_nan=True)
    assert np.isnan(y).any() == np.isnan(values).any()


@pytest.mark.parametrize("order", ["sorted", "shuffled"])
def test_every_dot_of_a_cloud_is_drawn(order: str) -> None:
    """Whatever the order of x, and though many lie close together."""
    rng = np.random.default_rng(0)
    x = np.linspace(0.0, 1.0, 1200) if order == "sorted" else rng.uniform(size=1200)
    y = 0.01 * rng.standard_normal(1200)

    def make() -> plots.Figure:
        figure, panels = plots.panels(1, 1, 2.0)
        plots.dots(panels[0, 0], x, y, "#123456")
        return figure

    svg = str(plots.drawn(make, "cloud"))
    (path,) = re.findall(r'<path d="([^"]*)"[^>]*stroke: #123456', svg)
    assert path.count("M") == 1200  # lines of hardly a length, whose round caps are the dots
    drawn = BytesIO()
    make().savefig(drawn, facecolor="white")
    ink = np.asarray(Image.open(drawn).convert("L")) < 200
    columns = np.flatnonzero(ink[20:-60].any(axis=0))
    assert len(columns) > 0.8 * np.ptp(columns)  # 1200 dots of three pixels fill a width of 900


# -- figures -----------------------------------------------------------------------------------------------------------


def test_drawing_leaves_matplotlib_as_it_was_and_gives_the_same_picture_again() -> None:
    def draw() -> Any:
        figure, axes = plots.panels(1, 2, 2.0)
        plots.curve(axes[0, 0], np.arange(5.0), np.array([1.0, 2.0, np.nan, 1.0, 0.5]))
        axes[0, 1].plot([1, 1000], [1, 1000])
        axes[0, 1].set(xscale="log", yscale="log")
        plots.put_legend(axes[0, 0], [("_hidden $x$", "red"), (EVIL, "blue")])
        return figure

    before = dict(matplotlib.rcParams)
    first = plots.drawn(draw, EVIL)
    assert dict(matplotlib.rcParams) == before
    assert plots.drawn(draw, EVIL) == first
    tree = parsed(first)
    assert tree.get("aria-label") == EVIL and tree.get("role") == "img"
    texts = [text.text_content() for text in tree.iter("text")]
    assert (
        "_hidden $x$" in texts
        and EVIL in texts
        and "1000" in texts
        and "0.5" not in first.split("<g")[0]
    )
    assert not any("mathdefault" in text for text in texts)
    assert "<style" not in first and "nan" not in first.lower().replace(EVIL, "")


def test_tick_labels_keep_all_their_digits() -> None:
    def draw() -> Any:
        figure, axes = plots.panels(1, 1, 2.0)
        axes[0, 0].plot([0, 1], [0.0, 0.0025])
        axes[0, 0].set_yticks([0.0, 0.0005, 0.0025])
        return figure

    texts = [text.text_content() for text in parsed(plots.drawn(draw, "ticks")).iter("text")]
    assert {"0.0005", "0.0025"} <= set(texts)


# -- what is said ------------------------------------------------------------------------------------------------------


def weighted_rms(values: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Root mean square of masked values, per column, as `Accuracy` counts the rows."""
    return np.sqrt(np.sum(values**2, axis=0) / np.sum(share**2, axis=0))


@pytest.mark.parametrize("holdout", ["none", "log:1"])
def test_the_rows_shown_are_the_rows_judged(holdout: str) -> None:
    rig = Rig.load("turret")
    logs = [bench(rig, seed=1, name="a.csv"), bench(rig, seed=2, name="b.csv")]
    found = identify(rig, logs, holdout=holdout)
    judged = found.held_out or found.train
    shown = evaluate(found, logs)
    error_rms = weighted_rms(shown.stacked("error"), shown.stacked("share"))
    assert error_rms == pytest.approx(list(judged.torque_rmse.values()), rel=1e-9)
    moving = shown.stacked("share") > 0.999
    apart = (shown.stacked("measured") - shown.stacked("predicted") - shown.stacked("error"))[
        moving
    ]
    # A row counts as moving with up to a thousandth of it masked, and friction jumps by about the torque's own size.
    assert (
        moving.mean() > 0.3 and np.abs(apart).max() < 3e-3 * np.abs(shown.stacked("measured")).max()
    )
    assert [part.log for part in shown.parts] == ["a.csv", "b.csv"][
        : 1 if holdout == "log:1" else 2
    ]


def test_the_parameters_table_holds_every_parameter_with_its_interval(walk: Walk) -> None:
    section = show_parameters(
        walk.found, compare_payload(walk.found), evaluate(walk.found, walk.logs)
    )
    rows = cells(section, "Base parameters") + cells(section, "Friction and other effects")
    theta = walk.found.estimate.theta
    std = walk.found.estimate.std
    assert len(rows) == len(theta)
    for row, value, deviation in zip(rows, theta, std):
        half = value_of(row[3])
        assert half == pytest.approx(1.96 * deviation, rel=0.06)
        assert value_of(row[2]) == pytest.approx(value, abs=0.06 * half + 1e-12)
    truth = dict(zip(walk.found.names, [*nominal_beta(walk), *walk.rig.friction.ravel()]))
    assert [value_of(row[5]) for row in rows] == pytest.approx(
        list(truth.values()), rel=1e-3, abs=1e-12
    )


def test_a_table_of_torque_is_a_line_and_folded_on_the_page(walk: Walk) -> None:
    """However many values it has, what is printed has a line for it, with its largest value and the place of that."""
    (log,) = walk.logs
    pan = log.q[:, 0]
    still = np.zeros(len(log))
    knots = np.linspace(*np.quantile(pan, (0.1, 0.9)), 31)
    table = TorqueTable("pan", "angle", tuple(knots.tolist()))
    torque = np.array(table.basis(Sample(pan, still, still, still, still, still))).T @ (
        0.5 * np.cos(5 * knots)
    )
    tau = log.tau + np.column_stack([torque, still])
    found = identify(
        walk.rig, [replace(log, tau=tau)], [table], filtering=Filtering(8.0), holdout="none"
    )
    lines = show_parameters(found, compare_payload(found)).to_text().splitlines()
    (said,) = (line for line in lines if "torque-table" in line)
    assert "31 values" in said and re.search(
        r"\d\.\d+ ± \d\.\d+ where it is largest, at −?\d+\.\d+°", said
    )
    plain = show_parameters(walk.found, compare_payload(walk.found)).to_text().splitlines()
    assert not walk.found.warnings and len(lines) <= len(plain) + 1 + len(found.warnings) + 2
    section = show_parameters(
        found, compare_payload(found), evaluate(found, [replace(log, tau=tau)])
    )
    assert len(cells(section, "Friction and other effects")) == 4
    assert (
        str(section.html).count("pan.angle_") >= 31
        and "<details><summary>pan: torque-table" in section.html
    )
    assert len(found.to_dict()["base_parameters"]) == len(walk.found.names) + 31


def nominal_beta(walk: Walk) -> np.ndarray:
    """Return the base parameters of the rig's URDF."""
    from gimbal_pin.dynamics import name_columns

    return walk.found.reduction.mixing @ walk.rig.phi[name_columns(walk.rig)[1]]


def test_a_regrouping_breaks_between_its_terms() -> None:
    spans = re.findall("<span>(.*?)</span>", tables.regrouping("a.Ixx - b.Izz + 0.12*c.m"))
    assert spans == ["a.Ixx", "−\u00a0b.Izz", "+\u00a00.12·c.m"]


@given(st.lists(st.lists(TEXTS, min_size=3, max_size=3), max_size=5))
def test_terminal_and_page_show_the_same_cells(rows: list[list[str]]) -> None:
    """In the terminal without their marks, a line each, in columns that begin or end below each other."""
    table = Table(
        ["a", "b", "c"], [[elements.toned(first, "good"), *rest] for first, *rest in rows], texts=2
    )
    page = parsed(f"<div>{Markup(table)}</div>").xpath("//tbody/tr")
    shown = [
        " ".join(" ".join(cell.text_content().split()) for cell in row).split() for row in page
    ]
    head, *lines = str(table).splitlines()
    assert head.split() == ["a", "b", "c"]
    assert " ".join(lines).split() == [word for row in shown for word in row]


def swapped(result: Tracking, joint: str) -> Tracking:
    """Return the tracking as if the two controllers had changed places on one joint."""
    other = {RIVAL: "computed-torque", "computed-torque": RIVAL}
    experiments = tuple(
        replace(e, joints={**e.joints, joint: result.of(e.name, other[e.controller]).joints[joint]})
        for e in result.experiments
    )
    return replace(result, experiments=experiments)


def cautions(walk: Walk, tuning: Tuning | None, result: Tracking | None = None) -> list[str]:
    """Return what the summary warns of, but for that nothing was run on the gimbal."""
    said = summary(walk.rig, walk.found, tuning, result).doubts
    return [one for one in said if one != SIMULATED.format("the identified model")]


def test_the_axis_on_which_the_model_does_not_help_is_named(walk: Walk) -> None:
    def doubts(judged: Judgement) -> tuple[str, ...]:
        return summary(walk.rig, walk.found, judged=judged).doubts

    ours, pid = (rows.copy() for rows in walk.judged.errors.values())
    ours[:, 1], pid[:, 1] = pid[:, 1].copy(), ours[:, 1].copy()
    worse = replace(walk.judged, errors=dict(zip(walk.judged.errors, (ours, pid))))
    assert cautions(walk, None, walk.result) == [] and not any(
        "closely" in one for one in doubts(walk.judged)
    )
    assert any(
        one.startswith("On tilt, a PID") and one.endswith("at least as closely.")
        for one in doubts(worse)
    )
    assert (
        "unexplained" in verdict(50.0)
        and "unexplained" in verdict(nan)
        and "unexplained" not in verdict(99.0)
    )
    assert "not to be run" in verdict(99.0, "", barred=True)


def test_no_multiplier_is_shown_of_a_plant_that_the_controller_knows(walk: Walk, page: str) -> None:
    """How many times closer than PID says nothing of the gimbal where the plant is the model."""
    words = parsed(page.partition("<iframe")[0] + page.rpartition("</iframe>")[2]).text_content()
    assert not re.search(r"times as (closely|much)|closer than|Tracks closer|\d ×", words)
    assert (
        SIMULATED.format("the identified model") in words
        and "simulated, not run on the gimbal" in words
    )
    sent = summary(walk.rig, walk.found, None, None, walk.logs)
    assert SIMULATED.format("the identified model") not in sent.doubts


def test_no_controller_is_praised_that_is_not_to_be_run(walk: Walk) -> None:
    model_based = walk.tunings["computed-torque"]
    doubted = replace(model_based, doubts=("pan: not to be run: its inertia is open",))
    shown, safe = (
        parsed(str(summary(walk.rig, walk.found, tuning, walk.result).section.html))
        for tuning in (doubted, model_based)
    )
    said = shown.text_content()
    assert (
        doubted.doubts[0] in said
        and "not to be run" in shown.xpath("//p[contains(@class, 'headline')]")[0].text
    )
    assert "not to be run" not in safe.text_content() and "is safer" not in said


@pytest.mark.parametrize(
    ("low", "high"), [(0.02, 0.08), (0.11, 0.9), (0.5, 30.0), (1e-6, 1e3), (2.1, 2.9)]
)
def test_a_logarithmic_axis_has_labels_that_tell_its_scale(low: float, high: float) -> None:
    """Two at least wherever two round numbers lie within it; over many decades no more than the powers of ten."""

    def make() -> Any:
        figure, axes = plots.panels(1, 1, 2.0)
        axes[0, 0].set(yscale="log", ylim=(low, high), xticks=[])
        return figure

    labels = [x for x in re.findall(r">([^<>]+)</text>", str(plots.drawn(make, "x"))) if x.strip()]
    assert len(labels) >= (3 if high > 3 * low else 1) and len(labels) <= 12


def test_torques_of_one_table_are_in_one_unit() -> None:
    assert (
        numbers.torque_text(2e-4) == "0.20 mN m" and numbers.torque_text(2e-4, 0.5) == "0.00020 N m"
    )
    assert numbers.torque_text(0.4, 2e-4) == numbers.torque_text(0.4)


def test_page_and_terminal_claim_median_and_worst_of_the_perturbed_plants(
    walk: Walk, page: str
) -> None:
    """The same figures as JSON: the errors of controller and PID, and their ratio."""
    found = walk.judged.to_dict()
    table = str(tables.judgement(walk.judged, list_shown_joints(walk.rig)))
    ratio = found["ratios"]["computed-torque"]
    claimed = "{} ({})".format(
        *(numbers.figures(ratio[of]["pan"], 2) for of in ("median", "worst"))
    )
    assert claimed in table and claimed in parsed(page).text_content() and "on 2 plants" in page
    assert claimed in show_judgement(walk.judged).to_text()


def test_the_better_figure_is_marked() -> None:
    assert tables.better("x", 1.0, [1.0, 1.04]) == tables.better("x", 1.0, [1.0]) == "x"
    assert isinstance(tables.better("x", 1.0, [1.0, 1.2, nan]), Markup)


def test_the_model_based_controller_has_the_joint_s_colour_whatever_the_order(walk: Walk) -> None:
    first = [e for e in walk.result.experiments if e.name == "all-axes"]
    ahead = replace(walk.result, experiments=tuple(first))
    behind = replace(walk.result, experiments=tuple(first[::-1]))
    assert show_tracking(ahead).html == show_tracking(behind).html


def test_a_rival_at_its_torque_limit_and_a_poor_model_are_spoken_of(walk: Walk) -> None:
    calm = swapped(walk.result, "pan")
    assert cautions(walk, None, calm) == []
    stuck = replace(
        calm,
        experiments=tuple(
            replace(
                e,
                joints={
                    j: replace(m, saturated=0.5 * (e.controller == RIVAL))
                    for j, m in e.joints.items()
                },
            )
            for e in calm.experiments
        ),
    )
    (said,) = cautions(walk, None, stuck)
    assert (
        said.startswith("PID with feed-forward is at the torque limit")
        and "50 %" in said
        and "no fair rival" in said
    )
    text = parsed(str(summary(walk.rig, walk.found, None, stuck).section.html)).text_content()
    assert said in text
    vague = walk.found.model.estimated
    assert vague is not None
    unsure = Model(
        walk.rig, walk.found.model.terms, replace(vague, covariance=vague.covariance * 1e8)
    )
    tuning = tune(unsure, dt=0.002)
    assert any("not to be run" in said for said in cautions(walk, tuning))
    assert not any(
        "is safer" in said for said in cautions(walk, tuning)
    )  # by the same model no PID is, either
    assert any("is safer" in said for said in cautions(walk, replace(tuning, doubts=())))


def test_the_absolute_path_of_a_log_is_nowhere(walk: Walk) -> None:
    name = "/home/someone/logs/bench.csv"
    page = str(
        show_logs(walk.rig, [replace(walk.logs[0], name=name, events=("something happened",))]).html
    )
    assert "someone" not in page and "bench.csv: something happened" in page


def test_an_error_is_said_with_the_band_that_it_is_of(walk: Walk) -> None:
    head = summary(walk.rig, walk.found, logs=walk.logs)
    notes = {card.label: card.note for card in head.numbers}
    assert "to 8 Hz" in notes["Fit of the torque"] and "to 8 Hz" in notes["Torque error"]
    none = replace(walk.found.held_out, fit_percent=dict.fromkeys(walk.rig.joints, nan))
    silent = summary(walk.rig, replace(walk.found, held_out=none), logs=walk.logs)
    words = parsed(str(silent.section.html)).text_content()
    assert "– %" not in words and "there is no fit where there is no torque" in words


def test_sliding_joints_are_shown_in_millimetres(slid: Walk) -> None:
    rig = slid.rig
    (joint,) = list_shown_joints(rig)
    assert (joint.text(0.0123, "/s"), joint.text(np.inf)) == ("12.3\u00a0mm/s", numbers.DASH)
    text = str(show_rig(rig).html + show_logs(rig, slid.logs).html)
    assert "−200\u00a0mm … 200\u00a0mm" in text and "°" not in text and "position, mm" in text
    evaluated = evaluate(slid.found, slid.logs)
    several = (
        show_parameters(slid.found, compare_payload(slid.found), evaluated),
        show_torque(slid.found, evaluated),
        show_judgement(slid.judged),
        show_tracking(slid.result),
    )
    words = (
        parsed(f"<div>{text}{join(one.html for one in several)}</div>")
        .text_content()
        .replace("\u00a0", " ")
    )
    head = parsed(
        str(summary(rig, slid.found, None, slid.result, slid.logs).section.html)
    ).text_content()
    for shown in (words, head):
        assert not re.search(r"\bm?N m\b|/rad", shown)
    assert "°" not in words and "N s/m" in words and "torque, N" in words


def test_the_terminal_and_json_have_the_units_of_joints_that_slide(slid: Walk) -> None:
    """N, m and kg where a joint that turns has N m, rad and kg m²: in findings, tables, reasons, `check` and files."""
    rig = slid.rig
    (log,) = slid.logs
    log = replace(log, tau=log.tau + 20.0 * (log.q - 0.02) + 0.05)
    wrong = diagnose(rig, [log], rng=0)
    (spring,) = wrong.findings
    assert spring.cause == "cable-spring" and {p.unit for p in spring.parameters} == {"N/m", "m"}
    shown = (
        show_check(check(rig)).to_text(),
        show_parameters(slid.found, compare_payload(slid.found)).to_text(),
        show_diagnosis(wrong).to_text(),
    )
    shown += tuple(show_controller(one).to_text(detailed=True) for one in slid.tunings.values())
    files = (
        to_json(slid.found.to_dict()),
        to_json(wrong.to_dict()),
        to_json(slid.tunings["pid"].to_dict()),
    )
    for said in (*shown, *files):
        assert not re.search(r"\bm?N m\b|\brad\b|/rad|\d kg m²", said), said
        assert all("margin" in line or "Hz" in line for line in said.splitlines() if "°" in line), (
            said
        )
    assert (
        "−200 mm … 200 mm" in shown[0]
        and "Torque limit, N " in shown[0]
        and " 30.0 " in shown[0]
        and "° to and fro" not in shown[2]
    )


@pytest.mark.parametrize("cause", CAUSES)
def test_no_cause_speaks_of_turns_where_a_joint_slides(cause: str) -> None:
    units = " ".join(p.unit for p in CAUSES[cause].stated())
    assert not re.search(r"N m\b|\brad\b|turn", to_sliding(units))


def test_a_rig_without_a_camera_hears_nothing_of_one(slid: Walk) -> None:
    """Nor of a payload and its balance; one that states a camera does."""
    assert not slid.rig.aims and Rig.load("turret").aims and Rig.load("turret", "none").aims
    payload = compare_payload(slid.found)
    assert not payload.lines and not payload.advice
    shown = whole(slid, why="its joints cannot turn sledge to where it should look")
    words = parsed(shown).xpath("//main")[0].text_content() + str(
        show_parameters(slid.found, payload, evaluate(slid.found, slid.logs)).html
    )
    words += show_parameters(slid.found, payload).to_text()
    assert not re.search(r"camera|Camera|line of sight|balance|Balance|slide the|payload", words)


def test_payload_and_motors_are_those_of_the_rig() -> None:
    rig = Rig.load("thesis", "cinema")
    section = show_rig(rig)
    moved = sum(body.mass for body in rig.model.inertias[1:])
    without = sum(body.mass for body in Rig.load("thesis", "none").model.inertias[1:])
    said = re.search(r"Payload <b>cinema</b> \(([\d.]+) kg\)", section.html)
    assert said is not None and float(said[1]) == pytest.approx(moved - without, abs=0.01)
    told = show_rig(rig, 0.5).html
    weighed = re.search(
        r"mass ([\d.]+) kg.*</b> \(0.500 kg as weighed; its URDF says ([\d.]+)", told
    )
    assert weighed is not None and weighed[2] == said[1]
    assert float(weighed[1]) == pytest.approx(without + 0.5, abs=0.01)
    assert cells(section, "Joints and limits")[1][:3] == ["roll", "fork", "−50.0° … 50.0°"]
    assert cells(section, "Motors, sensors and loads, as given")[0][-1] == numbers.figures(moved)


# -- the page ----------------------------------------------------------------------------------------------------------


def test_the_whole_report_has_every_part(page: str, animation: str) -> None:
    tree = parsed(page)
    titles = [heading.text_content() for heading in tree.iter("h2")]
    assert titles[:-3] == [
        "Summary",
        "Animation",
        "Parameters",
        "Torque",
        "Controller",
        "Perturbed plants",
    ]
    assert titles[-3:] == ["Tracking", "Data", "Rig"]
    assert [link.get("href") for link in tree.xpath("//nav//a")] == [
        f"#{s.get('id')}" for s in tree.iter("section")
    ]
    assert embedded(tree.xpath("//iframe")[0]) == animation
    around = re.sub(
        r"<script>\n/\*\nThe MIT License.*?</script>",
        "",
        page.replace(elements.INFLATE, ""),
        flags=re.S,
    )
    assert len(around) < 0.8e6
    identifiers = re.findall(r' id="([^"]*)"', around)
    assert len(set(identifiers)) == len(identifiers)
    pointed = re.findall(r"url\(#([^)]*)\)", around) + re.findall(r'href="#([^"]*)"', around)
    assert set(pointed) <= set(identifiers)
    for drawing in tree.iter("svg"):
        curves = sum(path.get("d").count("L") > 20 for path in drawing.iter("path"))
        assert (
            drawing.xpath(".//defs//*[@style]") == []
        )  # no rule of a page reaches into what is used
        assert drawing.get("aria-label") and curves + len(list(drawing.iter("use"))) > 1


def test_names_that_would_break_the_page_are_only_text() -> None:
    rig = Rig.load("turret")
    evil = tuple(f"{EVIL}{k}" for k in range(rig.n))
    rig = replace(
        rig,
        name=EVIL,
        joints=evil,
        payload=EVIL,
        config=replace(rig.config, description=EVIL, motors={}),
    )
    walk = walked(rig, EVIL)
    assert (
        parsed(Document(EVIL, "", [Section("x", [Markup("y")])]).to_html()).findtext(".//title")
        == EVIL
    )
    tree = parsed(whole(walk))
    assert len(tree.xpath("//script")) == 2 and tree.xpath("//main//b//script") == []
    assert tree.findtext(".//h1").startswith(EVIL)
    drawn = [text.text_content() for text in tree.iter("text")]
    for name in evil:
        assert any(name in text for text in drawn)
        assert any(name == cell.text_content() for cell in tree.xpath("//tbody//th"))


def test_the_summary_says_on_what_the_steps_were_simulated(walk: Walk) -> None:
    for plant in ("the identified model", "another rig"):
        kept = {} if plant == "the identified model" else {"plant": plant}
        section = summary(walk.rig, walk.found, None, walk.result, walk.logs, **kept).section
        assert SIMULATED.format(plant) in parsed(str(section.html)).text_content()


def test_a_diagnosis_plays_the_log_and_the_stretch_that_the_model_explains_least() -> None:
    """The page says which, and scene and charts have its clock."""
    rig = Rig.load("turret")
    first, second = (
        bench(rig, 70.0, 100.0, seed, name) for seed, name in ((1, "a.csv"), (2, "b.csv"))
    )
    tau = np.asarray(second.tau).copy()
    tau[6000:6200] += 0.3 * tau.std(axis=0) * np.sin(np.arange(200) / 5)[:, None]
    found = diagnose(rig, [first, replace(second, tau=tau)], rng=0, holdout="last-third")
    page = describe_record(found).to_html()
    said = re.search(
        r"Shown is b\.csv: ([\d.]+) to ([\d.]+) s, where the model leaves most\.", page
    )
    assert (
        said is not None
        and 0 < float(said[1]) < 10
        and float(said[2]) == pytest.approx(float(said[1]) + 60, abs=0.1)
    )
    tree = parsed(page)
    (frame,) = tree.xpath("//iframe")
    clocks = tree.xpath("//section[.//h2='Animation']//*[@class='charts']/@data-clock")
    assert clocks == [frame.get("data-clock")] == [elements.hash_clock("b.csv")]


def test_auto_says_its_outcome_in_a_screen_and_all_of_it_when_asked(walk: Walk) -> None:
    """First what was found, what to do, and what to take care of, as the page's head has it."""
    found = gather(walk, why="no IMU")
    head = found.summary
    page = parsed(str(found.summary.section.html)).text_content()
    brief, everything = (describe_outcome(found, verbose).splitlines() for verbose in (False, True))
    assert brief[:3] == [head.found, "What to do", f"  {head.to_do[0]}"]
    why = "No camera was held on a platform that moves: no IMU."
    assert head.doubts == (why, SIMULATED.format("the identified model"))
    assert all(f"  {doubt}" in brief for doubt in head.doubts) and found.payload.lines[0][
        1:
    ] in "".join(brief)
    shown = [card for card in head.numbers if card.is_headline]
    assert (
        all(any(line.startswith(card.label) for line in brief) for card in shown)
        and len(brief) <= 15
    )
    assert all(f"  {one}" in everything for one in (*head.to_do, *head.doubts))
    assert len(everything) > 60 and head.found in everything and "out/report.html" in everything[-1]
    assert head.found in page and head.to_do[0] in page


def test_a_whole_run_has_the_model_s_parameters_as_its_table(walk: Walk) -> None:
    assert gather(walk).to_frame().equals(walk.found.to_frame())


def test_a_long_log_makes_no_long_report() -> None:
    rig = Rig.load("turret")
    log = bench(rig, seconds=1200.0)
    assert len(log) == 300_000
    assert len(show_logs(rig, [log]).html) < 300_000


# -- a real browser ----------------------------------------------------------------------------------------------------


CUT = """[...document.querySelectorAll('.plot, .table')].filter(part => part.scrollWidth > part.clientWidth + 1)
  .map(part => [part.scrollWidth, part.clientWidth, part.textContent.slice(0, 40)])"""
"""Figures and tables of which the page's width leaves something out."""

FIRST = """(() => { const [first, ...rest] = document.querySelectorAll('section');
  return [first.getBoundingClientRect().bottom, first.querySelector('.rig svg').checkVisibility(),
    rest.filter(one => one.offsetHeight > 90).length]; })()"""
"""Where the first section ends, pixels, whether it draws the rig, and how many of the others are not folded."""


@needs_browser
def test_a_screen_holds_the_decision_and_the_rig_and_the_rest_opens_by_its_name(
    page: str, tmp_path: Path
) -> None:
    path = tmp_path / "report.html"
    path.write_text(page, encoding="utf-8")
    last = "document.querySelector('nav li:last-child a').click()"
    seen = visit(path.as_uri(), wide(1280), FIRST, last, pause(0.3), FIRST)
    (bottom, is_drawn, unfolded), _, (_, _, opened) = seen.values
    assert bottom <= 800 and is_drawn and (unfolded, opened) == (0, 1) and seen.complaints == []


def test_a_drawing_names_the_joints_in_question_and_the_way_to_balance() -> None:
    rig = Rig.load("thesis")
    known = compare_payload(identify(rig, [bench(rig)], filtering=Filtering(8.0))).balance
    assert known is not None
    moved = replace(known, way=np.array([0.003, 0.0, -0.002]), std=np.full(3, 1e-4))
    said = elements.paragraph("decided")
    figure = parsed(str(Markup(RigDrawing(rig, ["roll"], moved, [said]))))
    assert "decided" in figure.text_content()
    assert (
        figure.findtext(".//figcaption") == "in question: roll; to balance: 3 mm forward, 2 mm down"
    )
    names = [text.text_content() for text in figure.iter("text")]
    assert names == ["roll"] and str(RigDrawing(rig, ["roll"], moved, [said])) == "decided"
    unknown = replace(moved, std=np.full(3, 1.0))
    assert "balance" not in str(Markup(RigDrawing(rig, [], unknown, [])))


PRINTED = """(() => { const scene = document.querySelector('iframe').contentWindow;
  const c = document.createElement('canvas').getContext('2d'), count = () => {
    c.clearRect(0, 0, 300, 150); c.drawImage(scene.document.querySelector('canvas'), 0, 0, 300, 150);
    return new Set(new Uint32Array(c.getImageData(0, 0, 300, 150).data.buffer)).size; };
  for (const one of [window, scene]) one.dispatchEvent(new Event('beforeprint')); return count(); })()"""
"""How many colours the scene's canvas holds while the page is printed."""


@needs_browser
def test_paper_shows_the_scene_as_a_still(page: str, tmp_path: Path) -> None:
    """And charts as figures, and what is folded opened."""
    path = tmp_path / "report.html"
    path.write_text(page, encoding="utf-8")
    shown = "['.scene', '.plot', '.charts', '.below', 'nav', 'details p, details li, details td'].map(one =>"
    shown += " [...document.querySelectorAll(one)].filter(x => x.checkVisibility()).length)"
    seen = visit(path.as_uri(), wide(700), pause(1.0), PRINTED, media("print"), shown, WIDER)
    printed, (scenes, figures, charts, hints, menus, folded), wider = seen.values
    assert printed > 100
    assert scenes == 1 and figures == page.count('class="plot"') and folded > 20
    assert charts == hints == menus == wider == 0 and seen.complaints == []


@needs_browser
def test_axe_has_nothing_against_the_report_light_or_dark(
    page: str, animation: str, tmp_path: Path
) -> None:
    time = datetime(2026, 1, 2, 3, 4, tzinfo=timezone.utc)
    origin = Origin(time, "gimbal-pin auto <rig>", [("log.csv", 64 * "a")], {"model": "model.yaml"})
    head = Document(
        "page", "what it is", [Section("x", [elements.paragraph("y")])], origin
    ).to_html()
    assert (
        "2026-01-02 03:04 UTC" in head
        and "auto &lt;rig&gt;" in head
        and 'href="model.yaml"' in head
    )
    for text in (head, page, animation):
        path = tmp_path / "page.html"
        found = list[Any]()
        path.write_text(text, encoding="utf-8")
        audits = [
            step
            for scheme in ("light", "dark")
            for step in (media("screen", scheme), pause(0.5), audit(found))
        ]
        visit(path.as_uri(), OPEN, wide(1280), *audits)
        assert found == []


@needs_browser
def test_nothing_is_cut_off_on_a_desktop(page: str, tmp_path: Path) -> None:
    """At any width of a window on half a screen or a whole one, contents beside the page or above it."""
    path = tmp_path / "report.html"
    path.write_text(page, encoding="utf-8")
    widths = (800, 960, 1000, 1180, 1181, 1250, 1400)
    seen = visit(path.as_uri(), OPEN, *(step for pixels in widths for step in (wide(pixels), CUT)))
    assert dict(zip(widths, seen.values[1:])) == {pixels: [] for pixels in widths}
