"""The three reports, each one self-contained HTML file made of shared sections."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pneuid.criticism.comparison.comparison import Comparison
from pneuid.criticism.comparison.ladder import Rung
from pneuid.criticism.decision.diagnosis import Diagnosis
from pneuid.estimation.profile import Profile
from pneuid.report import decision_sections, sections
from pneuid.report.html import Section, write_report
from pneuid.report.trust_sections import friction_section, trust_section


def identify_report(
    path: str | Path,
    comparison: Comparison,
    ladder_rungs: Sequence[Rung],
    diagnosis: Diagnosis | None = None,
    profiles: Sequence[Profile] = (),
) -> None:
    """Write the report of an identification: what was fitted, how good it is, where it fails, how it was reached."""
    parts = [sections.summary(comparison)]
    if len(ladder_rungs) > 1:
        parts.append(decision_sections.ladder_section(ladder_rungs))
    if diagnosis is not None:
        parts += [decision_sections.diagnosis_verdict(diagnosis), decision_sections.ranking_section(diagnosis)]
    parts += [sections.parameters(comparison.model), trust_section(comparison, profiles), *_evidence(comparison)]
    write_report(path, f"Identification of {comparison.model.name}", parts)


def compare_report(path: str | Path, comparison: Comparison) -> None:
    """Write the report of a comparison: the model against these runs, and where it fails."""
    parts = [sections.summary(comparison), *_evidence(comparison)]
    parts.insert(-1, sections.parameters(comparison.model))
    write_report(path, f"Comparison of {comparison.model.name} with measurements", parts)


def diagnose_report(path: str | Path, comparison: Comparison, diagnosis: Diagnosis, rungs: Sequence[Rung]) -> None:
    """Write the report of a diagnosis: the verdict, the evidence, and the model it started from."""
    parts = [
        decision_sections.diagnosis_verdict(diagnosis, comparison.model.rig.patm),
        decision_sections.ladder_section(rungs),
        decision_sections.ranking_section(diagnosis),
        sections.summary(comparison),
        *_evidence(comparison),
    ]
    parts.insert(-1, sections.parameters(comparison.model))
    write_report(path, f"What is missing from {comparison.model.name}", parts)


def _evidence(comparison: Comparison) -> list[Section]:
    friction = friction_section(comparison)
    return [
        sections.errors(comparison),
        sections.where_it_fails(comparison),
        sections.overlays(comparison),
        *([friction] if friction else []),
        sections.data_section(comparison),
    ]
