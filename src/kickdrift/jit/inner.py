"""Functions that only compiled code calls. They are linked into their callers and get no machine code of their own.

By default numba optimises each function separately and makes its machine code, with everything that it calls inside. A
force of eighty functions, six calls deep, is then compiled many times over, although only its driver runs. Here such a
function stays in its lowered form until its driver is optimised as one piece.
"""

from collections.abc import Callable
from functools import update_wrapper
from typing import Any

from llvmlite.binding import Linkage
from numba import extending, jit

from kickdrift.jit import numba_front as numba_front  # shorter work for the same code
from kickdrift.jit.numba_private import (
    CompilerBase,
    CPUDispatcher,
    DefaultPassBuilder,
    JITCodeLibrary,
    NativeLowering,
    OverloadTemplate,
    PassManager,
    canonicalize_cfg,
    make_function,
    new_error_context,
    pass_registry,
    register_pass,
)

OPTIONS = {"nopython": True, "boundscheck": None, "error_model": "numpy"}  # for all code of kickdrift


class _InnerLibrary(JITCodeLibrary):
    """Lowered LLVM code, for linking into other libraries."""

    function: Callable[..., Any]  # the source of this code
    _linkable = False

    def _optimize_final_module(self) -> None: ...

    def _finalize_final_module(self) -> None:
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """The module itself, where numba changes the linkage in a copy, because nothing else uses this module."""
        if not self._linkable:
            for function in self._final_module.functions:
                if not function.is_declaration and function.linkage == Linkage.external:
                    function.linkage = "linkonce_odr"
            self._linkable = True
        return self._final_module


@register_pass(mutates_CFG=True, analysis_only=False)
class _InnerLowering(NativeLowering):
    _name = "inner_lowering"

    def run_pass(self, state: Any) -> bool:
        state.library = _InnerLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.function = state.func_id.func
        state.flags.no_cpython_wrapper = state.flags.no_cfunc_wrapper = state.flags.no_compile = True
        super().run_pass(state)
        lowered = state.cr
        fndesc = lowered.fndesc  # numba looks the code up by this name; no code calls it
        key = make_function(fndesc.lookup_module(), fndesc.qualname, "", 0, lowered.env, (state.library,))
        state.targetctx.insert_user_function(key, fndesc, [state.library])
        state.cr = lowered._replace(cfunc=key)
        return True


class _Passes(PassManager):
    """numba's passes, without the reports, timers and lifetimes of variables that it makes anew after each pass."""

    def _runPass(self, _: int, each: Any, state: Any) -> None:
        each.analysis = self._analysis
        with new_error_context("Pass {name}", name=each.name()):
            each.run_initialization(state)
            each.run_pass(state)
            each.run_finalizer(state)
        if pass_registry.get(type(each)).mutates_CFG:
            state.func_ir.blocks = canonicalize_cfg(state.func_ir.blocks)


class InnerCompiler(CompilerBase):
    """numba's compiler with another library for lowered code."""

    def define_pipelines(self) -> list[Any]:
        pipeline = _Passes("inner")
        pipeline.passes = [
            (_InnerLowering, "inner lowering") if of is NativeLowering else (of, what)
            for of, what in DefaultPassBuilder.define_nopython_pipeline(self.state).passes
        ]
        pipeline.finalize()
        return [pipeline]


class Inner(CPUDispatcher):
    """Function for compiled code. A call from Python, as in tests, compiles it once more."""

    def __init__(self, py_func: Callable[..., Any], locals: Any = None, targetoptions: Any = None) -> None:
        super().__init__(py_func, locals or {}, targetoptions, InnerCompiler)
        self._alone: CPUDispatcher | None = None

    def add_overload(self, cres: Any) -> None:
        self.overloads[tuple(cres.signature.args)] = cres  # not added to the functions that Python can call

    def _compile_for_args(self, *args: Any, **kws: Any) -> CPUDispatcher:
        if self._alone is None:
            self._alone = CPUDispatcher(self.py_func, self.locals, self.targetoptions)
        return self._alone  # numba then calls this function


def functions_in(library: Any) -> list[Callable[..., Any]]:
    """Functions for compiled code whose code was linked into a library, directly or not."""
    found, waiting = {}, [library]
    while waiting:
        each = waiting.pop()
        if id(each) not in found:
            found[id(each)] = each
            waiting += each._linking_libraries
    return [each.function for each in found.values() if isinstance(each, _InnerLibrary)]


def inner(**options: Any) -> Callable[[Callable[..., Any]], Inner]:
    """Decorator like ``numba.njit`` with these options."""
    return lambda function: Inner(function, targetoptions=OPTIONS | options)


_jit_decorator = OverloadTemplate._get_jit_decorator


def _inner_for_numba(template: Any) -> Any:
    """Decorator for the code of an overload. That of numba's own, such as ``np.zeros``, stays in its lowered form too:
    numba made machine code of each, and two wrappers, for every type of arguments."""
    jitter = _jit_decorator(template)
    if jitter is not jit or not (template._overload_func.__module__ or "").startswith("numba."):
        return jitter
    return lambda **options: jit(**{"pipeline_class": InnerCompiler} | options)


OverloadTemplate._get_jit_decorator = _inner_for_numba


def overload(function: Callable[..., Any], forceinline: bool = False, **options: Any) -> Callable[..., Any]:
    """``numba.extending.overload`` for functions of compiled code."""
    jit_options = {"pipeline_class": InnerCompiler} | ({"forceinline": True} if forceinline else {})
    return extending.overload(function, jit_options=jit_options, **options)


def by_type(rule: Any = None, **options: Any) -> Any:
    """Decorator: a function of compiled code whose body follows from the types of its arguments.

    ``rule`` has the function's name, arguments and docstring. It takes the types and returns the code for them, or
    None. ``options`` are those of `overload`.
    """
    if rule is None:
        return lambda rule: by_type(rule, **options)

    def stub(*given: Any) -> Any:
        raise NotImplementedError("for compiled code")

    overload(stub, **options)(rule)
    return update_wrapper(stub, rule)
