"""Tables of what others know, made in Python, and the parameters that they are about."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayeschute.study.schema.knowledge.knowledge_schema import KnowledgeTable

NAMES = ("axial[1]", "axial[alpha^2]", "transverse[e]", "transverse[rate]", "riser_length")
TRUTH = np.array([0.85, -0.5, 0.2, -0.4, 71.0])


def table(**values):
    said = {"name": "k", "source": "tunnel", **values}
    return KnowledgeTable.model_validate(said)


def curve(target, rows, **values):
    return table(kind="curve", target=target, points=[[f"{a!r} rad", v, s] for a, v, s in rows], **values)


def told(study, *tables):
    return replace(study, knowledge=tables)
