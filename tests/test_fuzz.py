"""Laws of the fuzz campaign: a planted failure is caught, a sound verb is not blamed, a killed one loses nothing."""

from __future__ import annotations

import html
import io
import os
import re
import socket
import sys
import time
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
from fuzzing import (
    bombs,
    damaged_csv,
    damaged_xml,
    damaged_yaml,
    killing,
    laws,
    options,
    restarts,
    scripted,
    seeds,
    workers,
)
from fuzzing.case import PORT, Case, Place
from fuzzing.cases import READERS, Drawn

from gimbal_pin.cli import VERBS, main
from gimbal_pin.dynamics import nominal
from gimbal_pin.log import write_log
from tests.bench_logs import prescribed
from tests.rigs import bundled

PLACE = Place(1, "log", 0)
CASE = Case(("verb",), {"in.csv": b"t\n1\n"}, {"out.csv": b"old\n1\n"})


def complaint(line: str, code: int) -> None:
    """What a verb does that refuses its input."""
    sys.stderr.write(f"{line}\n")
    raise SystemExit(code)


def torn(name: str) -> Callable[[], None]:
    """A verb that leaves half a table."""
    return lambda: void(Path(name).write_bytes(b"t,q\n1,2\n3"))


def void(_: object) -> None:
    """Nothing comes back from a verb."""


PLANTED: dict[str, tuple[Callable[[], None], tuple[str, ...]]] = {
    "a sound refusal": (lambda: complaint("gimbal-pin: in.csv: is empty; write rows", 2), ()),
    "a sound result": (lambda: void(Path("out.csv").write_bytes(b"t,q\n1,2\n")), ()),
    "an exception": (lambda: void(float("x")), ("exception",)),
    "another exit code": (lambda: complaint("gimbal-pin: oh", 1), ("exit code",)),
    "an escape": (lambda: complaint("gimbal-pin: \x1b[31m: is no joint; name one", 2), ("control bytes",)),
    "an escape on standard output": (lambda: void(sys.stdout.write("\x9b31m\n")), ("control bytes",)),
    "a long message": (lambda: complaint(f"gimbal-pin: {'x' * 301}", 3), ("long message",)),
    "two lines": (lambda: complaint("gimbal-pin: a\ngimbal-pin: b", 2), ("message",)),
    "no line": (lambda: void(sys.exit(2)), ("message",)),
    "a library's line": (lambda: void(os.write(2, b"Error: from C++\n")), ("foreign line",)),
    "a warning": (lambda: void(sys.stderr.write("x.py:1: RuntimeWarning: overflow\n")), ("foreign line",)),
    "a partial file": (torn("out.csv"), ("partial file",)),
    "a temporary file": (lambda: void(Path(".out").touch()), ("partial file",)),
    "an old result that is gone": (lambda: Path("out.csv").unlink(), ("partial file",)),
    "an input changed": (lambda: void(Path("in.csv").write_bytes(b"t\n2\n")), ("input changed",)),
    "a hang": (lambda: [None for _ in iter(int, 1)].clear(), ("slow",)),
    "a wait": (lambda: time.sleep(60), ("slow",)),
    "a death": (lambda: os.abort(), ("died",)),
    "much of the memory": (lambda: void(np.ones(2**23)), ("memory",)),
    "all of the memory": (lambda: void(bytearray(1 << 44)), ("exception",)),
}
"""What a verb does → which laws that breaks."""


def test_every_planted_failure_is_caught_and_no_sound_verb_is_blamed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "SECONDS", 0.3)
    monkeypatch.setattr(workers, "WAITING", 0.6)
    monkeypatch.setattr(laws, "MEMORY", 2**25)
    names = list(PLANTED)

    def planted(words: Sequence[str]) -> None:
        PLANTED[words[0]][0]()

    def drawn(place: Place) -> Case:
        return Case((names[place.number],), CASE.inputs, CASE.old)

    places = iter([Place(1, "log", number) for number in range(len(names))])
    found = {names[result.place.number]: result for result in workers.results(places, drawn, planted, 1, tmp_path)}
    kinds = {name: tuple(failure.kind for failure in result.failures) for name, result in found.items()}
    assert kinds == {name: laws for name, (_, laws) in PLANTED.items()}


def kinds(case: Case, verb: Callable[[Sequence[str]], None], folder: Path) -> list[str]:
    """Return the laws that a verb breaks in a case."""
    (result,) = workers.results(iter([PLACE]), lambda _: case, verb, 1, folder)
    return [failure.kind for failure in result.failures]


def test_a_page_must_have_the_elements_of_one_with_plain_names(tmp_path: Path) -> None:
    def careless(words: Sequence[str]) -> None:
        page = f"<html><p>{words[1]}</p><svg><text>{words[2]}</text></svg></html>"
        Path("out.html").write_text(page, encoding="utf-8")

    plain = Case(("page", "a", "b"), {})
    for text in ("<script>alert(1)</script>", "<img src=x onerror=alert(1)>", "</p><p>"):
        assert kinds(replace(plain, words=("page", text, "b"), plain=plain), careless, tmp_path) == ["foreign element"]
        assert kinds(replace(plain, words=("page", html.escape(text), "b"), plain=plain), careless, tmp_path) == []
    drawn = replace(plain, words=("page", "a", "</text><script>alert(1)</script>"), plain=plain)
    assert kinds(drawn, careless, tmp_path) == ["foreign element"]


def test_names_that_are_code_stand_in_every_input_and_nothing_else_differs(valid: seeds.Seeds) -> None:
    names = {name: f"{name} {one}" for name, one in zip(scripted.NAMED, scripted.SCRIPTS)}
    files = scripted.named(valid, names)
    text = html.unescape("".join(files[name].decode() for name in ("pan.urdf", "block.urdf", "pan.yaml", "log.csv")))
    assert all(html.unescape(names[name]) in text for name in scripted.NAMED if not name.endswith("file"))
    case = scripted.scripted(np.random.default_rng(1), valid, "animate pan.yaml log.csv -o out.html")
    assert case.plain is not None and len(case.plain.words) == len(case.words) and case != case.plain


def test_pipes_are_filled_slowly_or_not_at_all(tmp_path: Path) -> None:
    content = b"t,q\n" + b"1,2\n" * 50_000

    def reading(words: Sequence[str]) -> None:
        pipe = os.open("silent", os.O_RDONLY | os.O_NONBLOCK)
        found = Path("slow").read_bytes(), os.read(pipe, 9), Path("device").read_bytes()
        assert found == (content, b"", b"")

    case = Case(("read",), {}, pipes={"slow": content, "silent": None, "unread": content}, links={"device": os.devnull})
    assert kinds(case, reading, tmp_path) == []


def test_a_gimbal_answers_who_greets_it_and_what_it_must_lead_to_is_asked(valid: seeds.Seeds, tmp_path: Path) -> None:
    datagrams = tuple(restarts.sent(valid["log.csv"])[:20])

    def greeting(words: Sequence[str]) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as host:
            host.settimeout(5)
            host.sendto(b"hello", ("127.0.0.1", int(words[0].rpartition(":")[2])))
            assert [host.recv(65536) for _ in datagrams] == list(datagrams)

    assert kinds(Case((PORT,), {}, datagrams=datagrams, code=0), greeting, tmp_path) == []
    assert kinds(Case((PORT,), {}, datagrams=datagrams, code=2), greeting, tmp_path) == ["exit code"]
    drawn = [restarts.drawn(np.random.default_rng(seed), valid["log.csv"]) for seed in range(20)]
    assert {harmless for _, harmless in drawn} == {True, False}


def test_bombs_are_small_and_unfold_to_more_than_a_log_may_hold() -> None:
    unfolded = zlib.decompressobj(31).decompress(bombs.gz(), 2**26)
    assert unfolded == bytes(2**26)
    contents = {name: bombs.WRITERS[name]() for name in ("bomb.csv.gz", "bomb.npz", "lying.npz", "bomb.mat", "bomb.h5")}
    assert all(len(content) < 9e6 for content in contents.values())
    (_, shape, _), *_ = scipy.io.whosmat(io.BytesIO(contents["bomb.mat"]))
    with (
        h5py.File(io.BytesIO(contents["bomb.h5"])) as file,
        zipfile.ZipFile(io.BytesIO(contents["bomb.npz"])) as packed,
    ):
        assert not file["t"][-9:].any()
        sizes = [8 * shape[0], file["t"].nbytes, packed.infolist()[0].file_size]
    assert all(size > 2**30 for size in sizes)


def test_every_reader_gets_the_same_share_of_the_time() -> None:
    """Quick and slow ones, within one case of the slowest; each has a case before any has a second one."""
    cost = {"quick": 0.01, "slow": 0.5, "slower": 2.0}
    spent = dict.fromkeys(cost, 0.0)
    places = [Place(1, reader, number) for reader in cost for number in range(10_000)]
    order = []
    for place in workers.shared(places, spent):
        order.append(place.reader)
        spent[place.reader] += cost[place.reader]
        if sum(spent.values()) > 60:
            break
    assert set(order[:3]) == set(cost)
    assert max(spent.values()) - min(spent.values()) <= max(cost.values())


def test_a_case_is_drawn_from_its_seed_reader_and_number_alone(valid: seeds.Seeds) -> None:
    for reader in READERS:
        cases = [Drawn(valid)(Place(seed, reader, 7)) for seed in (1, 1, 2)]
        assert cases[0] == cases[1] != cases[2], reader


@pytest.mark.parametrize(
    ("damaged", "name"),
    [(damaged_csv.damaged, "log.csv"), (damaged_xml.damaged, "pan.urdf"), (damaged_yaml.damaged, "model.yaml")],
)
def test_nearly_every_damage_changes_the_input(
    damaged: Callable[[np.random.Generator, bytes], bytes], name: str, valid: seeds.Seeds
) -> None:
    changed = [damaged(np.random.default_rng(seed), valid[name]) != valid[name] for seed in range(30)]
    assert sum(changed) >= 25


def test_every_verb_and_every_option_of_its_help_is_tried(capsys: pytest.CaptureFixture[str]) -> None:
    assert options.LINES.keys() == VERBS.keys()
    for verb in VERBS:
        with pytest.raises(SystemExit):
            main([verb, "--help"])
        told = capsys.readouterr().out
        for option in options.options(verb):
            assert option.positional or f"--{option.name.replace('_', '-')}" in told, (verb, option)
        words = set(re.findall(r"(?<=[ │|])--(?!no-)[a-z][a-z-]*(?=[ ,\n])", told))
        tried = {f"--{option.name.replace('_', '-')}" for option in options.options(verb)}
        assert words - tried <= {f"--{name}" for name in (*options.LEFT_OUT, "help")}, verb


def test_a_killed_identify_leaves_the_old_model_or_the_new_one(tmp_path: Path) -> None:
    for name, seed in (("log.csv", 1), ("older.csv", 2)):
        write_log(prescribed(nominal(bundled("turret")), seed, seconds=8.0, dt=5e-3), tmp_path / name)
    seeds.called("identify", "turret", str(tmp_path / "log.csv"))  # imports what the forked ones need
    ends = killing.run(main, {"identify": killing.VERBS["identify"]}, 2, 1, tmp_path)
    assert all(end in killing.WHOLE for end in ends["identify"])


def test_a_verb_that_writes_in_place_is_found_out_when_it_is_killed(tmp_path: Path) -> None:
    def careless(words: Sequence[str]) -> None:
        with open(words[-1], "w", encoding="utf-8") as file:
            for number in range(40):
                file.write(f"{words[-3]} {number}\n")
                file.flush()
                time.sleep(0.005)

    ends = killing.run(careless, {"careless": ("careless", "turret", "log.csv", "-o", "out.yaml")}, 3, 1, tmp_path)
    assert "a damaged file" in ends["careless"]


@pytest.fixture(scope="module")
def valid() -> seeds.Seeds:
    """Inputs that look like the valid ones, quickly."""
    table = b"t,q_pan,dq_pan,tau_pan\n" + b"".join(b"%g,0.5,0.25,1\n" % (k / 100) for k in range(200))
    model = b"kind: gimbal_pin model\njoints: [pan]\nphi: [1, 2, 3]\nterms: [{effect: coulomb, values: [0.5]}]\n"
    tables = dict.fromkeys(["log.csv", "log2.csv", "reference.csv", "platform.csv", "mapped.csv"], table)
    packed = dict.fromkeys(
        ["log.parquet", "platform.parquet", *seeds.WRITERS, *bombs.WRITERS], b"PAR1" + table + b"PAR1"
    )
    models = ["model.yaml", "extended.yaml", "controller.yaml", "controller2.yaml", "pid.yaml"]
    text = {"pan.urdf": seeds.PAN, "pan.yaml": seeds.PAN_YAML, "block.urdf": seeds.MOUNTED, "map.yaml": seeds.MAPPING}
    written = {name: content.encode() for name, content in text.items()}
    return {**tables, **packed, **dict.fromkeys(models, model), **written, "part.stl": seeds.stl()}
