"""Folders that verbs work in."""

from __future__ import annotations

from dataclasses import replace

import bayeschute as bc
from bayeschute.api.workspace import collected, workspace


def test_files_are_there_while_a_verb_works_and_gone_afterwards():
    study = bc.Study.example().spec
    with workspace(study, {"fit/a.npz": b"1", "log.txt": b"2"}) as job:
        folder = job.out
        assert collected(folder) == {"fit/a.npz": b"1"} and job.resume
    assert not folder.exists()


def test_what_a_fit_kept_for_other_draws_is_not_taken():
    study = bc.Study.example().spec
    more = replace(study, sampler=study.sampler.model_copy(update={"draws": study.sampler.draws + 1}))
    hashes = set()
    for one in (study, more, replace(study, seed=study.seed + 1), study):
        with workspace(one) as job:
            hashes.add(job.hash)
    assert len(hashes) == 3
