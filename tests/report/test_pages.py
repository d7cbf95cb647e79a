"""Pages of records: every number of the record is there, in its unit and row, and no name is more than text.

Of each kind of record, of a rig whose joints turn and of one that slides and whose names are hostile:

- each number of ``to_dict()`` that its page is about stands in the row of its joint or parameter, scaled and rounded;
- the table, the notebook and the page hold what the dictionary and the terminal hold;
- no name ends an element, an attribute or a script; no folder of a log is told;
- showing a record does not change it;
- no quantity of a joint that slides has a unit of one that turns.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import lxml.html
import numpy as np
import pytest

from gimbal_pin import GimbalPinError, diagnose
from gimbal_pin.errors import NORMAL_95
from gimbal_pin.identification import identify
from gimbal_pin.log import to_json
from gimbal_pin.report import (
    describe_outcome,
    describe_record,
    evaluate,
    figures,
    show_rig,
    summary,
)
from gimbal_pin.report.format import interval, percent
from gimbal_pin.report.sections.diagnosis import find_worst_stretch
from tests.browsing import embedded
from tests.report.records import (
    EVIL,
    RECORDS,
    RIGS,
    SLIDING,
    clean_log,
    data_of,
    identified,
    log_of,
    notebook_of,
    page_of,
    record_of,
    tuned,
    whole,
)
from tests.rigs import bundled

SCALES = {
    ("turret", "place"): 180 / np.pi,
    ("slider", "place"): 1e3,
    ("turret", "force"): 1e3,
    ("slider", "force"): 1.0,
}
"""What a position in rad or m, and a small torque in N m or force in N, is multiplied by where it is shown."""

MODEL = [
    ("base_parameters/*", 1, "interval"),
    ("base_parameters/*/urdf", 1, 4),
    ("held_out/torque_rmse/*", "force", 3),
    ("train/torque_rmse/*", "force", 3),
    ("held_out/fit_percent/*", 1, "percent"),
    ("held_out/used/*", 100, ".0f"),
]
BODIES = [
    ("bodies/*/mass", 1, "interval"),
    ("bodies/*/com/*", 1e3, "interval"),
    ("bodies/*/inertia/*", 1, "interval"),
]
MARGINS = [
    ("*/*/crossover_hz", 1, 3),
    ("*/*/phase_margin_deg", 1, 3),
    ("*/*/gain_margin_db", 1, 3),
    ("*/*/disk_margin", 1, 3),
    ("*/*/delay_margin", 1e3, 3),
]
SHOWN: dict[str, list[tuple[str, float | str, int | str]]] = {
    "IdentificationResult": [*MODEL, *BODIES],
    "IdentificationResult without its logs": [*MODEL, *BODIES],
    "Several": MODEL[:2],
    "Diagnosis": [
        ("findings/*/parameters/*", 1, "interval"),
        ("findings/*/rivals/*", 1, "nats"),
        ("detection_limit/*", 1, 2),
        ("held_out/*/torque_rmse/*", 1, 2),
        ("held_out/*/fit_percent/*", 1, "left"),
    ],
    "Tuning": [
        *MARGINS,
        ("joints/*/bandwidth_hz", 1, 3),
        ("joints/*/k[pid]", 1, 3),
        ("joints/*/worst_of_draws/disk_margin", 1, 3),
        ("joints/*/drive/*/*", 1, 3),
    ],
    "Judgement": [("errors/*/*/*", "place", 3), ("ratios/*/*/*", 1, 2)],
    "Tracking": [("steps/*", "place", 3)],
    "Excitation": [("limits_used/*/*", 100, ".0f"), ("condition_number", 1, ".1f")],
    "ExpectedEstimate": [
        ("parameters/*/value", 1, 3),
        ("parameters/*/std", NORMAL_95, 3),
        ("lag_std/*", 1e3 * NORMAL_95, 2),
    ],
    "Rehearsal": [
        ("causes/*/seen_from/value", 1, 3),
        ("causes/*/seen_from/share_of_torque", 100, 2),
        ("causes/*/named_from/value", 1, 3),
    ],
    "Base": [("parameters", 1, ".0f"), ("identifiable", 1, ".0f")],
    "Checked": [
        ("joints/*/lower", "place", 3),
        ("joints/*/upper", "place", 3),
        ("joints/*/velocity", "place", 3),
        ("joints/*/tau_max", 1, 3),
    ],
    "Model": [("terms/*/values/*", 1, 3)],
    "Verified": [
        *((f"*/{path}", scale, count) for path, scale, count in MARGINS),
        ("pointing/*/jitter_*_deg", 1, 2),
        ("pointing/*/torque_rms/*", 1, 3),
    ],
    "MonteCarlo": [
        ("figures/rms_error*/*", "place", 3),
        ("figures/settling_time*/*", 1, 3),
        ("sensitivity/*/rank_correlation", 1, 3),
    ],
    "Fleet": [("population/*", 1, "interval")],
    "Inspected": [("streams/*/channels/*/low", 1, 4), ("streams/*/samples", 1, ".0f")],
}
"""Kind of record → path in its dictionary, what the number there is multiplied by, and how it is then written."""
STEPS = {
    "identify": "IdentificationResult",
    "diagnose": "Diagnosis",
    "tune": "Tuning",
    "track": "Tracking",
}
SHOWN["Auto"] = [
    (f"{step}/{path}", *rest) for step, of in STEPS.items() for path, *rest in SHOWN[of]
]

PAGE_WIDE = {"steps", "pointing_loops", "population"}
"""Of these the page shows the numbers elsewhere than in a row of that name."""


def normalised(text: str) -> str:
    """Return a text with plain signs and single spaces."""
    return " ".join(text.replace("−", "-").replace("·", "*").split())


def tokens(text: str) -> Counter[str]:
    """Return the numbers of a text, as they are written, and how often each is."""
    return Counter(re.findall(r"-?\d+(?:\.\d+)?(?:\*10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?", normalised(text)))


def key(name: object) -> str:
    """Return what the name of a row or of an entry is compared by."""
    return normalised(str(name)).replace("-", " ").lower()


def walk(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield each path of a tree and what stands there; an item of a list goes by its name."""
    yield path, value
    if isinstance(value, (list, tuple)):
        places = [
            one.get("name", one.get("controller", k)) if isinstance(one, dict) else k
            for k, one in enumerate(value)
        ]
        value = dict(zip(places, value))
    for place, one in value.items() if isinstance(value, dict) else ():
        yield from walk(one, (*path, str(place)))


def write(x: Any, scale: float, how: int | str) -> Counter[str]:
    """Return how a number is written; of one that is not known, or is not shown, nothing."""
    if how == "nats":
        return tokens(" ".join(interval(x["nats"], NORMAL_95 * x["std"])))
    if isinstance(x, Mapping):
        std = x.get("std", x.get("mean_std"))
        if std is None or not x.get("shown", True) or not x.get("is_known", True):
            return Counter()
        value = x.get("value", x.get("mean"))
        return tokens(" ".join(interval(scale * value, NORMAL_95 * scale * std)))
    if x is None or x == 0 or (how == "left" and x < -900):
        return Counter()
    if how == "percent":
        return tokens(percent(x))
    if how == "left":
        return tokens(figures(100 - x, 2))
    return tokens(figures(scale * x, how) if isinstance(how, int) else format(scale * x, how))


def words_of(tree: Any) -> str:
    """Return what is read of a page, with spaces between cells."""
    return " ".join(" ".join(tree.xpath(".//text()[not(parent::script or parent::style)]")).split())


def read_rows(page: str) -> dict[str, Counter[str]]:
    """Return name of a row or column → the numbers of all of that name; under no name all numbers."""
    body = lxml.html.fromstring(page).find("body")
    rows = defaultdict(Counter, {"": tokens(words_of(body))})
    for table in body.iter("table"):
        heads = [key(cell.text_content()) for cell in table.xpath(".//thead//th")]
        for row in table.xpath(".//tbody/tr"):
            cells = [tokens(words_of(cell)) for cell in row]
            rows[key(row[0].text_content())] += sum(cells[1:], Counter())
            for head, numbers in zip(heads, cells):
                rows[head] += numbers
    return rows


@pytest.mark.parametrize(("name", "kind"), [one for one in RECORDS if one[1] in SHOWN])
def test_every_number_of_a_record_stands_in_its_row(name: str, kind: str) -> None:
    rows = read_rows(page_of(name, kind))
    wanted = defaultdict(Counter)
    for path, found in walk(record_of(name, kind).to_dict()):
        named = [key(part) for part in path if not (part.isdigit() or PAGE_WIDE & {*path})]
        row = next((part for part in named if part in rows), "")
        for pattern, scale, how in SHOWN[kind]:
            parts = pattern.split("/")
            if len(parts) == len(path) and all(map(fnmatchcase, path, parts)):
                wanted[row] += write(found, SCALES.get((name, scale), scale), how)
    assert wanted
    assert {*wanted.pop("", ())} <= {*rows[""]}
    for row, numbers in wanted.items():
        assert numbers <= rows[row], row


@pytest.mark.parametrize(("name", "kind"), RECORDS)
def test_page_and_notebook_hold_the_numbers_of_the_terminal(name: str, kind: str) -> None:
    said = tokens(str(describe_record(record_of(name, kind)).to_text()))
    assert said
    for shown in (page_of(name, kind), notebook_of(name, kind)):
        assert {*said} <= {*tokens(words_of(lxml.html.fromstring(shown)))}


@pytest.mark.parametrize(("name", "kind"), RECORDS)
def test_a_record_shows_itself_and_stays_what_it_was(name: str, kind: str) -> None:
    """As a line, a table, a page and a notebook's part, and as a figure where its page has one."""
    record = record_of(name, kind)
    rows: Any = record.to_dict()
    for step in record.ROWS.split("."):
        rows = rows[step]
    if isinstance(rows, dict):
        rows = [{"name": place, **row} for place, row in rows.items()]
    for row, cells in zip(rows, record.to_frame().to_dict("records"), strict=True):
        for place, one in row.items():
            if isinstance(one, (str, int, float)):
                assert cells[place] == one or one != one
    assert 10 < len(repr(record)) <= 400
    assert "\n" not in repr(record)
    if "<svg" in page_of(name, kind) + notebook_of(name, kind):
        assert record.plot().axes
    else:
        with pytest.raises(GimbalPinError, match="plot: has nothing to draw of"):
            record.plot()
    assert to_json(record.to_dict()) == data_of(name, kind)


# -- names and units ---------------------------------------------------------------------------------------------------


def read_trees(page: str) -> Iterator[Any]:
    """Yield a page as a tree, then the pages in its frames."""
    tree = lxml.html.fromstring(page)
    yield tree
    for frame in tree.iter("iframe"):
        yield from read_trees(embedded(frame))


@pytest.mark.parametrize("kind", SLIDING)
def test_a_hostile_name_is_only_text(kind: str) -> None:
    page = page_of("slider", kind)
    for tree in (*read_trees(page), *read_trees(notebook_of("slider", kind))):
        attributes = {name for one in tree.iter() for name in one.attrib}
        assert all(re.fullmatch(r"[A-Za-z][\w:-]*", name) for name in attributes)
        assert "alert(1)" not in {script.text for script in tree.iter("script")}
    tree = lxml.html.fromstring(page)
    assert EVIL in tree.text_content()
    assert "/home/someone" not in page or kind == "Log"
    drawn = [text for svg in tree.iter("svg") for text in svg.itertext() if "slide " in text]
    assert all(EVIL in text for text in drawn)


@pytest.mark.parametrize("kind", SLIDING)
def test_a_joint_that_slides_has_no_unit_of_one_that_turns(kind: str) -> None:
    """Nor is there a word of a camera or a balance where the rig has neither."""
    page = words_of(lxml.html.fromstring(page_of("slider", kind)).find("body"))
    terminal = str(describe_record(record_of("slider", kind)).to_text(detailed=True))
    for said in (page, terminal, data_of("slider", kind) if kind != "Rig" else ""):
        # The loops' responses are drawn for a step of 1 rad/s²; a log alone does not know its rig.
        found = re.findall(r"\bm?N m\b|\brad\b(?!, or m|/s²)|/rad|\d kg m²", said)
        assert not found or kind == "Log"
    about = re.search(r"camera|line of sight|balance", page + terminal, re.I)
    assert not about or kind in ("Several", "Checked")


# -- what a run says, what is shown of logs and rigs -------------------------------------------------------------------


def test_a_run_says_its_outcome_and_all_of_it_when_asked(tmp_path: Path) -> None:
    found = replace(whole("slider"), files=dict.fromkeys(("model", "report"), tmp_path))
    brief, everything = (describe_outcome(found, verbose) for verbose in (False, True))
    page = lxml.html.fromstring(page_of("slider", "Auto"))
    for said in (found.summary.found, found.summary.to_do[0], *found.summary.doubts):
        assert said in brief
        assert said in everything
        assert said in page.text_content()
    assert embedded(page.xpath("//iframe")[0]) == found.recording
    links = [link.get("href") for link in page.xpath("//nav//a")]
    assert links == [f"#{name}" for name in page.xpath("//section/@id")]


def test_a_joint_that_a_pid_follows_better_is_named() -> None:
    model = identified("turret")
    judged = record_of("turret", "Judgement")
    ours, pid = judged.errors.values()
    swapped = (np.where([True, False], *pair) for pair in ((ours, pid), (pid, ours)))
    worse = replace(judged, errors=dict(zip(judged.errors, swapped)))
    assert summary(model.model.rig, model, tuned("turret"), judged=judged).doubts == ()
    (said,) = summary(model.model.rig, model, judged=worse).doubts
    assert [name in said for name in model.model.rig.joints] == [False, True]


def test_a_diagnosis_plays_the_stretch_that_the_model_explains_least() -> None:
    log = log_of("turret")
    tau = np.array(log.tau)
    tau[3500:3600] += tau.std(axis=0) * np.sin(np.arange(100) / 10)[:, None]
    logs = [replace(log, name="a.csv"), replace(log, name="b.csv", tau=tau)]
    shown, part = find_worst_stretch(diagnose(RIGS["turret"], logs), 3.0)
    assert shown.name == "b.csv"
    assert part.t[0] < 7.0 < 7.2 < part.t[-1] == pytest.approx(part.t[0] + 3.0)


def test_the_rows_shown_are_the_rows_judged() -> None:
    logs = [replace(clean_log("turret", k), name=f"{k}.csv") for k in range(2)]
    found = identify(RIGS["turret"], logs, holdout="log:1")
    shown = evaluate(found, logs)
    error, share, measured = map(shown.stacked, ("error", "share", "measured"))
    rms = np.sqrt(np.sum(error**2, axis=0) / np.sum(share**2, axis=0))
    assert [part.log for part in shown.parts] == ["0.csv"]
    assert rms == pytest.approx([*found.held_out.torque_rmse.values()], rel=1e-9)
    # A row counts as moving with up to a thousandth of it masked.
    apart = (measured - shown.stacked("predicted") - error)[share > 0.999]
    assert len(apart) > 0.3 * share.size
    assert np.abs(apart).max() < 3e-3 * np.abs(measured).max()


def test_a_log_is_shown_with_its_extremes() -> None:
    log = log_of("slider")
    rows = read_rows(page_of("slider", "IdentificationResult"))
    ends = 1e3 * np.array([log.q.min(), log.q.max(), np.abs(log.v).max()])
    for x in (*ends, np.sqrt(np.mean(np.square(log.tau))), np.abs(log.tau).max()):
        assert normalised(figures(x)) in rows[key(log.joints[0])]


def test_masses_are_those_of_the_rig_and_of_the_payload_as_weighed() -> None:
    rig = bundled("thesis", "cinema")
    masses = np.array([body.mass for body in rig.model.inertias[1:]])
    payload = masses.sum() - sum(x.mass for x in bundled("thesis", "none").model.inertias[1:])
    rows = read_rows(f"<html><body>{show_rig(rig, 0.5).html}</body></html>")
    assert {figures(masses.sum() - payload + 0.5), figures(payload), "0.500"} <= {*rows[""]}
    for j, joint in enumerate(rig.joints):  # each carries the next
        assert figures(masses[j:].sum()) in rows[key(joint)]


def test_draws_for_arviz_have_the_estimate_s_mean_and_covariance() -> None:
    pytest.importorskip("arviz")
    found = identified("turret")
    drawn = found.to_arviz(4000, rng=0).posterior
    table = np.array([drawn[name].to_numpy().ravel() for name in found.names])
    std = found.estimate.std
    error = (table.mean(axis=1) - found.estimate.theta) / std
    assert np.abs(error).max() < 5 / 4000**0.5
    spread = np.cov(table) / np.outer(std, std)
    np.testing.assert_allclose(spread, found.estimate.covariance / np.outer(std, std), atol=0.1)


def test_what_moves_is_a_scene_in_a_frame_and_in_a_file(tmp_path: Path) -> None:
    shown = record_of("turret", "Excitation").animate(tmp_path / "motion.html")
    (frame,) = lxml.html.fromstring(shown._repr_html_()).xpath("//iframe")
    assert frame.get("srcdoc") == shown.page == (tmp_path / "motion.html").read_text()
    with pytest.raises(GimbalPinError, match="animate: has nothing that moves"):
        tuned("turret").animate()
