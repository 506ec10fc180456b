"""The stages by name: what each reads, calls and leaves."""

from __future__ import annotations

from bayeschute.study.simulate import simulate_study
from bayeschute.study.work_data import ingest, priors
from bayeschute.study.work_fit import fit
from bayeschute.study.work_report import report
from bayeschute.study.work_results import check, predict, risk
from bayeschute.study.work_structure import structure

__all__ = ["check", "fit", "ingest", "predict", "priors", "report", "risk", "simulate_study", "structure"]
