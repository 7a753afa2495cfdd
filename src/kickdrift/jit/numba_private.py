"""Every private name of numba that kickdrift needs. Any version may change these, so each is checked here.

A missing name, or an untested version of numba, raises an `InputError` of one line. `numba_front`, which only
shortens numba's work, does without those attributes of these objects that a version lacks.
"""

from importlib import import_module
from typing import Any

import numba

from kickdrift.errors import InputError

OLDEST, NEWEST = (0, 61), (0, 68)  # tested versions; pyproject.toml has the same bounds


def _version() -> tuple[int, int]:
    major, minor = numba.__version__.split(".")[:2]
    return int(major), int(minor)


def _works() -> str:
    return f"numba {'.'.join(map(str, OLDEST))} to {'.'.join(map(str, NEWEST))} works"


def private(module: str, name: str) -> Any:
    """Return the object of that name. Raises InputError if this version of numba does not have it."""
    try:
        return getattr(import_module(f"numba.{module}"), name)
    except (ImportError, AttributeError):
        raise InputError(f"numba {numba.__version__} has no numba.{module}.{name}; {_works()}") from None


if not OLDEST <= _version() <= NEWEST:
    raise InputError(f"numba {numba.__version__} is not supported; {_works()}")

errors = private("core", "errors")
event = private("core", "event")
itanium_mangler = private("core", "itanium_mangler")
lowering = private("core", "lowering")
PostProcessor = private("core.postproc", "PostProcessor")
VariableLifetime = private("core.postproc", "VariableLifetime")
NumbaError = private("core.errors", "NumbaError")
NumbaWarning = private("core.errors", "NumbaWarning")
UnsupportedBytecodeError = private("core.errors", "UnsupportedBytecodeError")
TypingError = private("core.errors", "TypingError")
make_function = private("_dynfunc", "make_function")
FunctionIdentity = private("core.bytecode", "FunctionIdentity")
CFunc = private("core.ccallback", "CFunc")
cgutils = private("core", "cgutils")
CPUCodegen = private("core.codegen", "CPUCodegen")
CPUCodeLibrary = private("core.codegen", "CPUCodeLibrary")
JITCodeLibrary = private("core.codegen", "JITCodeLibrary")
CPUContext = private("core.cpu", "CPUContext")
CompileResult = private("core.compiler", "CompileResult")
CompilerBase = private("core.compiler", "CompilerBase")
DefaultPassBuilder = private("core.compiler", "DefaultPassBuilder")
PassManager = private("core.compiler_machinery", "PassManager")
pass_registry = private("core.compiler_machinery", "_pass_registry")
register_pass = private("core.compiler_machinery", "register_pass")
global_compiler_lock = private("core.compiler_lock", "global_compiler_lock")
new_error_context = private("core.errors", "new_error_context")
Intrinsic = private("core.extending", "_Intrinsic")
Inst = private("core.ir", "Inst")
Var = private("core.ir", "Var")
impl_ret_borrowed = private("core.imputils", "impl_ret_borrowed")
CPUDispatcher = private("core.registry", "CPUDispatcher")
cpu_target = private("core.registry", "cpu_target")
rtsys = private("core.runtime", "rtsys")
NRTContext = private("core.runtime.context", "NRTContext")
ConfigStack = private("core.targetconfig", "ConfigStack")
TargetConfig = private("core.targetconfig", "TargetConfig")
canonicalize_cfg = private("core.transforms", "canonicalize_cfg")
as_dtype = private("np.numpy_support", "as_dtype")
Conversion = private("core.typeconv", "Conversion")
dumps = private("core.serialize", "dumps")
NativeLowering = private("core.typed_passes", "NativeLowering")
BaseFunction = private("core.types.functions", "BaseFunction")
AbstractTemplate = private("core.typing.templates", "AbstractTemplate")
AttributeTemplate = private("core.typing.templates", "AttributeTemplate")
ConcreteTemplate = private("core.typing.templates", "ConcreteTemplate")
OverloadTemplate = private("core.typing.templates", "_OverloadFunctionTemplate")
builtin_registry = private("core.typing.templates", "builtin_registry")
infer_getattr = private("core.typing.templates", "infer_getattr")
infer_global = private("core.typing.templates", "infer_global")
signature = private("core.typing.templates", "signature")
