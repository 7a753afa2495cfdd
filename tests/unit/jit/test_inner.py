"""Functions that only compiled code calls: they are part of their callers' machine code, and have none of their own."""

from __future__ import annotations

import operator
import pickle
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from numba import njit, types
from numba.core import ir
from numba.core.compiler import Flags, run_frontend

from kickdrift.jit import numba_front
from kickdrift.jit.compile import driver, in_order, inlined, is_finite, jit, strict
from kickdrift.jit.inner import _InnerLibrary, overload
from kickdrift.jit.numba_private import cpu_target, signature

KINDS = {"jit": jit, "inlined": inlined, "in_order": in_order, "strict": strict}


def halved(x):
    return 0.5 * x


def doubled(x):
    """Double a number, in compiled code."""


@overload(doubled)
def _doubled(x):
    return lambda x: 2.0 * x


@pytest.mark.parametrize("kind", KINDS)
def test_what_compiled_code_calls_is_in_its_machine_code_alone(kind):
    half = KINDS[kind](halved)

    @jit
    def twice_halved(x):
        return half(half(x)) + 0.0 * doubled(x)

    def quarter(x):
        return twice_halved(x)

    compiled = driver(quarter)
    compiled.__dict__["_cache"] = type(
        "NoCache", (), {"load_overload": lambda *a: None, "save_overload": lambda *a: 0}
    )()
    assert compiled(3.0) == 0.75
    for function in (half, twice_halved):
        (made,) = function.overloads.values()
        assert isinstance(made.library, _InnerLibrary)
        assert not made.library.codegen._engine.is_symbol_defined(made.fndesc.llvm_cpython_wrapper_name)
    assert half(3.0) == 1.5  # compiled for itself here
    assert half(np.float32(3.0)) == 1.5
    assert compiled(5.0) == 1.25


def test_inner_functions_can_be_pickled():
    assert pickle.loads(pickle.dumps(jit(halved)))(4.0) == 2.0


def sum_is_finite(a):
    return is_finite(a[0] + a[1] + a[2])


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_a_sum_that_may_be_reassociated_is_seen_to_be_no_number(wrong):
    """np.isfinite tests whether (a + b + c) - (a + b + c) is 0, which reassociation makes 0."""
    compiled = driver(sum_is_finite)
    assert compiled(np.array([1.0, 2.0, 3.0]))
    assert not compiled(np.array([1.0, wrong, 3.0]))


def test_flags_compare_by_their_values():
    flags, same, other = Flags(), Flags(), Flags()
    same.nrt = flags.options["nrt"].default  # set to the value that unset flags have
    other.forceinline = True
    assert flags.values() == {name: getattr(flags, name) for name in flags.options}
    assert (flags, hash(flags)) == (same, hash(same))
    assert flags != other
    assert flags != "flags"


def test_a_call_that_is_resolved_again_keeps_the_flags_around_it():
    """Reassociation may sum 1e16 + 1 - 1e16 to 1; the sum as written is 0 or 2."""

    def cancelled(x, y):
        return (x + y) - x

    exact, free = strict(cancelled), jit(cancelled)

    @driver
    def both(x, y):
        return exact(x, y), free(x, y), exact(x, y)

    assert both(1e16, 1.0) == (0.0, 1.0, 0.0)


def test_a_slice_from_another_shape_is_an_error():
    @njit
    def filled(a, b):
        a[1:] = b
        return a

    assert filled(np.zeros(3), np.ones(2)).tolist() == [0.0, 1.0, 1.0]
    with pytest.raises(ValueError, match="cannot assign"):
        filled(np.zeros(3), np.ones(3))


def test_variables_of_statements_are_listed_in_order():
    def variables(value):
        if isinstance(value, ir.Var):
            return [value.name]
        if isinstance(value, ir.Inst):
            return variables(value._kws if isinstance(value, ir.Expr) else vars(value))
        parts = value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ()
        return [name for part in parts for name in variables(part)]

    def function(a, b, *rest, c=1.0):
        found = {"first": (a[0:2], [b, c])}
        for k, each in enumerate(rest):
            found[k] = max(each, b, key=c) if each > a else print(each, *rest)
        return found

    statements = [each for block in run_frontend(function).blocks.values() for each in block.body]
    assert len({name for each in statements for name in variables(each)}) > 20
    for each in statements:
        assert [variable.name for variable in each.list_vars()] == variables(each)


def test_a_call_of_numbas_own_code_may_give_its_types_as_a_list():
    context = cpu_target.typing_context
    plus = context.resolve_value_type(operator.add)
    found = [plus.get_call_type(context, kind([types.intp, types.intp]), {}) for kind in (list, tuple, list)]
    assert found == 3 * [signature(types.intp, types.intp, types.intp)]
    assert plus.get_impl_key(found[0]) is operator.add


def test_a_version_of_numba_that_counts_no_registrations_refreshes_each_time(monkeypatch):
    asked = []
    monkeypatch.setattr(numba_front, "_refresh", asked.append)
    context = SimpleNamespace(typing_context=SimpleNamespace())
    for _ in range(2):
        numba_front._refresh_if_new(context)
    assert asked == [context, context]


def test_code_on_disk_may_be_the_first_thing_that_a_process_asks_for():
    told = "import kickdrift.jit.inner; from numba.core.registry import cpu_target; cpu_target.target_context.refresh()"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
