"""Laws of the fuzz campaign: a planted failure is caught, a sound verb is not blamed, a killed one loses nothing."""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))

from fuzzing import damaged_csv, damaged_xml, damaged_yaml, killing, options, seeds, workers
from fuzzing.case import Case, Place
from fuzzing.cases import READERS, Drawn

from gimbal_pin.cli import VERBS, main
from gimbal_pin.dynamics.model import nominal
from gimbal_pin.log.io import write_log
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
    "all of the memory": (lambda: void(bytearray(1 << 44)), ("exception",)),
}
"""What a verb does → which laws that breaks."""


def test_every_planted_failure_is_caught_and_no_sound_verb_is_blamed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "SECONDS", 0.3)
    monkeypatch.setattr(workers, "WAITING", 0.6)
    names = list(PLANTED)

    def planted(words: Sequence[str]) -> None:
        PLANTED[words[0]][0]()

    def drawn(place: Place) -> Case:
        return Case((names[place.number],), CASE.inputs, CASE.old)

    places = iter([Place(1, "log", number) for number in range(len(names))])
    found = {names[result.place.number]: result for result in workers.results(places, drawn, planted, 1, tmp_path)}
    kinds = {name: tuple(failure.kind for failure in result.failures) for name, result in found.items()}
    assert kinds == {name: laws for name, (_, laws) in PLANTED.items()}


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
    packed = dict.fromkeys(["log.parquet", "platform.parquet", *seeds.WRITERS], b"PAR1" + table + b"PAR1")
    models = ["model.yaml", "extended.yaml", "controller.yaml", "controller2.yaml", "pid.yaml"]
    text = {"pan.urdf": seeds.PAN, "pan.yaml": seeds.PAN_YAML, "block.urdf": seeds.MOUNTED, "map.yaml": seeds.MAPPING}
    written = {name: content.encode() for name, content in text.items()}
    return {**tables, **packed, **dict.fromkeys(models, model), **written, "part.stl": seeds.stl()}
