"""Compiled functions as LLVM code for WebAssembly.

numba lowers a function to LLVM code with types of numbers, arrays and tuples. This code becomes machine code of another
processor when it has another target, as long as nothing has optimised it: optimised code knows where the host's
compiler puts the parts of a tuple. Pointers have 32 bits in WebAssembly, so these places differ. Whole numbers keep
64 bits, also addresses that are whole numbers.

`own_process` must run first, in a process that has compiled nothing.
"""

import os
import re
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

from llvmlite import binding as llvm

from kickdrift.jit.inner import OPTIONS, Inner
from kickdrift.jit.numba_private import JITCodeLibrary, global_compiler_lock

TRIPLE = "wasm32-unknown-unknown"
LAYOUT = "e-m:e-p:32:32-p10:8:8-p20:8:8-i64:64-i128:128-n32:64-S128-ni:1:10:20"
FEATURES = "+simd128,+bulk-memory,+sign-ext,+nontrapping-fptoint,+mutable-globals"
# numba's settings for a processor without more than SSE2: no code for one kind of processor, no fused products
PLAIN_PROCESSOR = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
_COUNTING = re.compile(r"^define [^\n]*@(NRT_incref|NRT_decref)\(.*?^}$", re.MULTILINE | re.DOTALL)
_LONG_NAME = '@"?{}"?(?![\\w.$"])'


class Lowered(NamedTuple):
    """A compiled function before it is optimised.

    Attributes
    ----------
    name : of the function in ``text``, with numba's calling convention: pointers to the result and to an error first
    text : LLVM code of the function and of all that it calls
    kinds : LLVM types of the arguments after these two pointers
    """

    name: str
    text: str
    kinds: tuple[str, ...]


def own_process() -> None:
    """Let numba keep all code as it is lowered, in this process and from now on."""
    assert all(os.environ.get(name) == value for name, value in PLAIN_PROCESSOR.items()), "see PLAIN_PROCESSOR"
    JITCodeLibrary._optimize_functions = lambda library, module: None
    JITCodeLibrary._optimize_final_module = lambda library: None


def lowered(function: Callable[..., Any], kinds: Sequence[Any], **options: Any) -> Lowered:
    """Lower a Python function for arguments of these numba types. ``options`` are numba's, beside kickdrift's own."""
    made = Inner(function, targetoptions=OPTIONS | options)
    made.compile(tuple(kinds))
    found = made.overloads[tuple(kinds)]
    with global_compiler_lock:
        found.library._ensure_finalized()
    name = found.fndesc.llvm_func_name
    module = found.library._final_module
    arguments = [str(each.type) for each in module.get_function(name).arguments]
    return Lowered(name, str(module), tuple(arguments[2:]))


@cache
def _machine() -> Any:
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    return llvm.Target.from_triple(TRIPLE).create_target_machine(opt=3, features=FEATURES, reloc="static")


@cache
def target_data() -> Any:
    """Sizes and places of types in WebAssembly's memory."""
    return llvm.create_target_data(LAYOUT)


def machine_code(parts: Sequence[Lowered], glue: str, exports: Sequence[str]) -> bytes:
    """Object file of these functions and of ``glue``, LLVM code beside them, optimised for WebAssembly.

    ``exports`` names what stays visible in the object file; the rest is inlined or removed."""
    module = llvm.parse_assembly(_for_wasm(glue))
    for part in parts:
        module.link_in(llvm.parse_assembly(_for_wasm(part.text)))
    for each in (*module.functions, *module.global_variables):
        if not each.is_declaration and each.name not in exports:
            each.linkage = "internal"
    module.verify()
    machine = _machine()
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization = options.slp_vectorization = True
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return bytes(machine.emit_object(module))


def _for_wasm(text: str) -> str:
    """The code with WebAssembly as its target, and arrays that nobody counts: no page makes or frees an array."""
    text = re.sub(r'^target datalayout = ".*"$', f'target datalayout = "{LAYOUT}"', text, flags=re.MULTILINE)
    text = re.sub(r'^target triple = ".*"$', f'target triple = "{TRIPLE}"', text, flags=re.MULTILINE)
    return _COUNTING.sub(r"define linkonce_odr void @\1(ptr %0) {\n  ret void\n}", text)
