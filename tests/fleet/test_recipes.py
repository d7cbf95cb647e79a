"""Recipes of docs/pages/scale.md: the programs that they start take the options that they give."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from distributed.cli import dask_scheduler, dask_worker

from gimbal_pin.cli import parse_arguments
from tests.test_docs import ROOT, blocks

BLOCKS = {block.title: block.text for block in blocks(ROOT / "docs" / "pages" / "scale.md")}


def accept(words: list[str]) -> str:
    """Let the program that a command line calls parse its options; its name."""
    if words[0] == "gimbal-pin":
        parse_arguments(words[1:])
        return words[1]
    programs = {"scheduler": dask_scheduler.main, "worker": dask_worker.main}
    programs[words[1]].make_context(words[1], words[2:])
    return words[1]


def test_kubernetes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    parts = list(yaml.safe_load_all(BLOCKS["cluster.yaml"]))
    service = next(part for part in parts if part["kind"] == "Service")
    pods = [part["spec"]["template"] for part in parts if "template" in part["spec"]]
    commands = [container["command"] for pod in pods for container in pod["spec"]["containers"]]
    assert [accept(words) for words in commands] == ["scheduler", "worker", "montecarlo"]
    address = f"tcp://{service['metadata']['name']}:{service['spec']['ports'][0]['port']}"
    assert all(address in words for words in commands[1:])
    assert any(pod.get("metadata", {}).get("labels") == service["spec"]["selector"] for pod in pods)
