"""The stages by name: inputs, function and outputs of each."""

from __future__ import annotations

from bayeschute.study.run.simulate import simulate_study
from bayeschute.study.run.stage_check import check
from bayeschute.study.run.stage_data import ingest, priors
from bayeschute.study.run.stage_fit import fit
from bayeschute.study.run.stage_predict import predict, risk
from bayeschute.study.run.stage_report import report
from bayeschute.study.run.stage_structure import structure

__all__ = ["check", "fit", "ingest", "predict", "priors", "report", "risk", "simulate_study", "structure"]
