"""Comparisons that come with the program lead to its numerics: a file of its own, as any change of these breaks it."""

from __future__ import annotations

from functools import cache, partial

from bayeschute.study.evidence.numerics_compared import comparisons, identical_to, same_as
from bayeschute.study.evidence.numerics_hash import PACKAGE, engine, hash_of


def test_shipped_comparisons_lead_to_the_present_numerics_and_pass():
    """Others have no use any more; what is identical to something the same leads there, too. The engine may be another."""
    found = comparisons()
    kinds = {row.configuration for one in found for row in one.studies}
    numerics_on = cache(partial(hash_of, PACKAGE))
    for one in found:
        here = numerics_on(engine(one.provenance["versions"]))
        alike = identical_to(here, found).union(*(same_as(here, kind, found) for kind in kinds if one.identical))
        assert alike & {one.before, one.after}
        assert one.identical or all(one.same(row.configuration) for row in one.studies)
        assert all(one.provenance[key] for key in ("command", "commit", "date", "machine", "versions"))
