"""What is said of a diagnosis: each finding has its sentence, and no sentence says more than was found."""

from __future__ import annotations

from dataclasses import replace

from gimbal_pin.diagnosis import Diagnosis
from gimbal_pin.report import describe_record, report_diagnosis, summary
from gimbal_pin.report.diagnosis_text import state_verdict
from tests.report.records import RIGS, diagnosed, identified, record_of

SPOILT = "Diagnosis of spoilt logs"
GIVEN_KEYS = {"cause", "joint", "status", "class", "parameters", "gain", "rivals"}


def spoil_fit(found: Diagnosis, joint: str, fit: float) -> Diagnosis:
    """Return a diagnosis whose extended model fits a joint's held-out torque to so many per cent."""
    assert found.held_out is not None
    extended = found.held_out.extended
    worse = replace(extended, fit_percent={**extended.fit_percent, joint: fit})
    return replace(found, held_out=replace(found.held_out, extended=worse))


def test_each_finding_has_a_sentence_and_an_ambiguous_one_an_experiment() -> None:
    for found in (diagnosed("turret"), diagnosed("slider"), record_of("turret", SPOILT)):
        assert isinstance(found, Diagnosis)
        told = report_diagnosis(found)
        assert told["schema"] == 2
        assert told["findings"]
        for row in told["findings"]:
            assert {*row} >= GIVEN_KEYS
            assert row["sentence"]
            if row["status"] != "data":
                assert (row["next_experiment"] is not None) == (row["status"] == "ambiguous")
                assert row["cause"] in row["sentence"]


def test_an_unconfirmed_finding_is_not_stated_as_a_cause() -> None:
    found = diagnosed("slider")
    (finding,) = found.findings
    doubtful = replace(found, findings=(replace(finding, status="unconfirmed"),), verdict="unknown")
    assert finding.cause not in state_verdict(doubtful)
    assert finding.cause in describe_record(doubtful).to_text()
    said = summary(RIGS["slider"], identified("slider"), wrong=doubtful)
    assert finding.cause not in said.found
    assert not any(finding.cause in line for line in said.to_do)


def test_a_joint_that_is_half_unexplained_or_made_worse_is_never_called_sound() -> None:
    sound = replace(diagnosed("turret"), findings=(), verdict="nothing")
    assert sound.held_out is not None
    joint = RIGS["turret"].joints[0]
    assert not sound.unexplained
    for fit in (49.0, 85.0):
        found = spoil_fit(sound, joint, fit)
        assert found.unexplained == [joint]
        assert joint in state_verdict(found) != state_verdict(sound)
        told = summary(RIGS["turret"], identified("turret"), wrong=found)
        assert joint in told.found
        assert told.tone != "good"
        better = found.deteriorations[joint]
        assert any(joint in line and better in line for line in told.doubts)
