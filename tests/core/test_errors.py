from __future__ import annotations

import pickle

import pytest

from bayeschute.core.errors import Fault, FitError, InputError


def test_a_fault_is_one_line_with_where_got_wanted_do():
    fault = Fault("x.toml [prior.C_A0] sd", "-0.1", "sd > 0", "Make it positive.")
    assert str(fault) == "x.toml [prior.C_A0] sd: got -0.1; wanted sd > 0. Make it positive."


def test_advice_may_be_left_out():
    assert str(Fault("a", "b", "c")) == "a: got b; wanted c."


@pytest.mark.parametrize("many", [False, True])
def test_an_input_error_holds_its_faults_in_order(many: bool):
    faults = (Fault("a", "b", "c"), Fault("d", "e", "f")) if many else (Fault("a", "b", "c"),)
    error = InputError(faults if many else faults[0])
    assert error.faults == faults
    assert str(error).splitlines() == [str(fault) for fault in faults]
    assert isinstance(error, ValueError)


def test_a_fit_error_holds_what_is_known_all_the_same():
    bare = FitError("it did not come to rest")
    assert str(bare) == bare.reason == "it did not come to rest" and isinstance(bare, RuntimeError)
    assert bare.tried == bare.paths == bare.parameters == ()
    told = FitError("why", ["first", "second"], [1], [("a", 1.0, 0.1, "m")])
    again = pickle.loads(pickle.dumps(told))  # a worker may send it
    assert (again.reason, again.tried, again.paths) == ("why", ("first", "second"), (1,))
    assert again.parameters == (("a", 1.0, 0.1, "m"),)
