"""Compiles a law to an object file by Numba: native code for any x86-64 processor, without calls of Python or malloc.

Numba's functions return a status. The entry points made here turn it into the fault code of the C interface: an index
out of bounds, or an exception, is a fault. Numba's own cfunc would call Python there.
"""

from __future__ import annotations

import ast
import copy
import ctypes
import importlib
import os
import re
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from . import law_layout as layout
from .errors import Error
from .law_link import undefined_symbols
from .law_rules import Function, refuse

# Symbols that the program's own libraries provide: mathematical functions of the C library, memory copies.
_C_FUNCTIONS = set(
    "acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fabs floor fma fmax "
    "fmin fmod frexp hypot ldexp lgamma log log10 log1p log2 modf nearbyint nextafter pow remainder rint round "
    "roundeven sin sincos sinh sqrt tan tanh tgamma trunc memcpy memmove memset".split()
)
_HINT = "docs/python_laws.md says what a law may contain"


def numba_version() -> str:
    """Versions of the compiler.

    Raises:
        Error: Numba is not installed; the text names the package.
    """
    try:
        numba = importlib.import_module("numba")
        llvmlite = importlib.import_module("llvmlite")
    except ImportError as missing:
        raise Error(
            f"a law needs Numba to be compiled, which is not installed here ({missing})",
            'pip install "multipanda[law]"; a compiled law (law.build(FOLDER)) needs neither Numba nor Python',
        ) from None
    return f"numba {numba.__version__}, llvmlite {llvmlite.__version__}"


def object_file(law: layout.Declaration, functions: dict[str, Function]) -> bytes:
    """The law's native code.

    Args:
        law: What it declares.
        functions: Its function `update`, perhaps also `start`.

    Raises:
        Refused: It cannot be compiled, allocates or calls Python; with file and line.
        Error: Numba is not installed.
    """
    numba_version()
    compiled = _compile(law, functions)
    if isinstance(compiled, bytes):
        bad = _foreign(compiled)
        if not bad:
            return compiled
        refuse(_place(law, functions, None), _why(bad), _HINT)
    refuse(_place(law, functions, compiled), _text(compiled), _HINT)


def _foreign(code: bytes) -> list[str]:
    return sorted(set(undefined_symbols(code)) - _C_FUNCTIONS)


def _why(symbols: Sequence[str]) -> str:
    names = ", ".join(symbols[:4])
    if any(name.startswith("NRT") for name in symbols):
        return f"it allocates memory ({names}), which the loop never does; write into tau, outputs or declared memory"
    return f"it calls {names}, which the loop does not have: it would call Python or allocate memory"


def _text(error: BaseException) -> str:
    """Numba's message in one sentence."""
    text = re.sub(r"\x1b\[[0-9;]*m", "", str(error))  # colors
    if "_ol_array_allocate" in text or "NRT required" in text or "_empty_nd_impl" in text:
        return (
            "it allocates memory, which the loop never does (an array made here: a product, a copy, np.zeros); write "
            "element by element into tau, outputs or declared memory"
        )
    if "readonly" in text and "setitem" in text:
        return "it writes into something that a law can only read; it writes into tau, outputs and memory"
    if "scipy" in text:
        return "it calls a linear-algebra library; use the matrix products of multipanda.law_math"
    lines = [line.strip() for line in text.splitlines()]
    said = [line for line in lines if line and not line.startswith(("Failed in", "During", "-", "File", "^", ">>>"))]
    return f"Numba cannot compile it: {' '.join(said[:2]) or type(error).__name__}"


def _place(law: layout.Declaration, functions: dict[str, Function], error: BaseException | None) -> str:
    """File and line of the statement that is refused: from Numba's message, otherwise by leaving out statements."""
    if error is not None:
        for file, line in re.findall(
            r'(?:File "|at |\s)([^"\s()]+?)"?(?:, line | \()(\d+)', re.sub(r"\x1b\[[0-9;]*m", "", str(error))
        ):
            for top in functions.values():
                for function in top.all():
                    span = range(function.tree.lineno + 1, (function.tree.end_lineno or 0) + 1)
                    if int(line) in span and os.path.basename(function.file) == os.path.basename(file):
                        return f"{function.file}:{line}"
    for name, function in functions.items():
        statements = list(_simple(function.tree.body))

        def refused(count: int, name: str = name, function: Function = function) -> bool:
            result = _compile(law, {**functions, name: _beginning(function, count)})
            return bool(_foreign(result)) if isinstance(result, bytes) else error is not None

        others_fine = refused(len(statements)) and not refused(0)
        if not others_fine:
            continue
        low, high = 0, len(statements)  # refused(low) is false, refused(high) is true
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if refused(middle) else (middle, high)
        return function.place(statements[high - 1])
    first = functions["update"]
    return first.place(first.tree)


def _simple(body: Sequence[ast.stmt]) -> Iterator[ast.stmt]:
    """Simple statements in the order of the source."""
    for statement in body:
        if isinstance(statement, (ast.For, ast.If)):
            yield from _simple([*statement.body, *statement.orelse])
        else:
            yield statement


def _beginning(function: Function, count: int) -> Function:
    """The function with its first `count` simple statements only."""
    tree = copy.deepcopy(function.tree)
    left = count

    def shorten(body: list[ast.stmt]) -> list[ast.stmt]:
        nonlocal left
        kept: list[ast.stmt] = []
        for statement in body:
            if left == 0:
                break
            if isinstance(statement, (ast.For, ast.If)):
                statement.body = shorten(statement.body)
                statement.orelse = shorten(statement.orelse) if statement.orelse else []
            else:
                left -= 1
            kept.append(statement)
        return kept or [ast.copy_location(ast.Pass(), function.tree)]

    tree.body = shorten(tree.body)
    return Function(function.name, function.file, tree, function.names, function.calls)


def _native(function: Function, jit: Callable[..., Any] | None) -> Any:
    """The function from its checked source; with `jit`, callable by others."""
    from numba import njit

    options = {"_nrt": False, "boundscheck": True, "error_model": "numpy", "no_cpython_wrapper": True}
    names = {**function.names, "__name__": "law"}
    for name, called in function.calls.items():
        names[name] = _native(called, njit(**options))
    module = ast.fix_missing_locations(ast.Module([function.tree], []))
    exec(compile(module, function.file, "exec"), names)  # noqa: S102  (the user's own function, without decorators)
    made = names[function.name]
    return jit(made) if jit is not None else made


def _compile(law: layout.Declaration, functions: dict[str, Function]) -> bytes | Exception:
    """The object file, or Numba's message."""
    from numba.core import compiler, types
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.registry import cpu_target

    # The baseline processor that the program is built for: the host's vector instructions may be missing elsewhere.
    context = cpu_target.target_context.with_aot_codegen("multipanda_law")
    flags = compiler.Flags()
    flags.no_compile, flags.no_cpython_wrapper, flags.no_cfunc_wrapper = True, True, True
    flags.nrt, flags.boundscheck, flags.error_model = False, True, "numpy"
    with global_compiler_lock:
        try:
            library = context.codegen().create_library("multipanda_law")
            entries = {}
            for kind, function in functions.items():
                names = [argument.arg for argument in function.tree.args.args]
                entries[kind] = (
                    names,
                    compiler.compile_extra(
                        cpu_target.typing_context,
                        context,
                        _native(function, None),
                        tuple(_types(law)[name] for name in names),
                        types.none,
                        flags,
                        {},
                        library=library,
                    ),
                )
            module = library.create_ir_module("multipanda_laws")
            pointers = {
                kind: _Entry(context, module, law).make(kind, names, result)
                for kind, (names, result) in entries.items()
            }
            _export(module, law, pointers)
            library.add_ir_module(module)
            library.finalize()
            for function in library.get_defined_functions():
                if function.name != "multipanda_laws" and function.linkage.name not in ("private", "internal"):
                    function.visibility = "hidden"
            return bytes(library.emit_native_object())
        except Exception as error:  # becomes the text of the refusal
            return error


def _types(law: layout.Declaration) -> dict[str, Any]:
    """Numba's type of each argument that a law may have."""
    types: Any = importlib.import_module("numba.core.types")

    def array(dimensions: int, written: bool = False) -> Any:
        return types.Array(types.float64, dimensions, "C", readonly=not written)

    def named(name: str, members: dict[str, Any]) -> Any:
        return types.NamedTuple(tuple(members.values()), layout.tuple_class(name, members))

    arm = named("Arm", {name: array(len(layout.ARM_FIELDS[name].shape)) for name in law.arm_fields})
    inputs = {}
    for name, spec in law.inputs.items():
        if spec.quantity in layout.SET_POINTS:
            members = layout.SET_POINTS[spec.quantity]
            inputs[name] = named("SetPoint", {m: array(len(shape)) for m, (_, shape) in members.items()})
        else:
            inputs[name] = types.float64 if spec.quantity == "scalar" else array(1)
    parameters = {n: types.float64 if p.size == 1 else array(1) for n, p in law.parameters.items()}
    return {
        "arm": arm,
        "arms": types.UniTuple(arm, law.arms),
        "tau": array(1, True) if law.arms == 1 else types.UniTuple(array(1, True), law.arms),
        "inputs": named("Inputs", inputs),
        "parameters": named("Parameters", parameters),
        "outputs": named("Outputs", {name: array(1, True) for name in law.outputs}),
        "memory": named("Memory", {name: array(1, True) for name in law.memory}),
        "contact": named("Contact", {name: types.float64 for name in layout.CONTACT}),
        "dt": types.float64,
        "time_s": types.float64,
    }


class _Entry:
    """An entry point with the C interface: loads pointers and makes Numba's arrays of them, without copying."""

    def __init__(self, context: Any, module: Any, law: layout.Declaration) -> None:
        from llvmlite import ir
        from numba.core import types

        self.ir, self.types, self.context, self.module, self.law = ir, types, context, module, law
        self.byte = ir.IntType(8)
        self.builder: Any = None

    def make(self, kind: str, names: Sequence[str], compiled: Any) -> Any:
        """Adds the function that calls the compiled one. Returns it."""
        ir, signature = self.ir, compiled.signature
        made = ir.Function(
            self.module, ir.FunctionType(ir.IntType(32), [self.byte.as_pointer()]), f"multipanda_law_{kind}"
        )
        made.linkage = "internal"
        self.builder = ir.IRBuilder(made.append_basic_block())
        tick = made.args[0]
        values = self._values(tick)
        target = self.context.declare_function(self.module, compiled.fndesc)
        status, _ = self.context.call_conv.call_function(
            self.builder, target, signature.return_type, signature.args, [values[name]() for name in names]
        )
        self.builder.ret(self.builder.zext(status.is_error, ir.IntType(32)))
        return made

    def _load(self, base: Any, structure: type[ctypes.Structure], member: str, index: int = 0) -> Any:
        offset = getattr(structure, member).offset + index * ctypes.sizeof(structure)
        kind = {ctypes.c_double: self.ir.DoubleType(), ctypes.c_uint64: self.ir.IntType(64)}.get(
            dict((f[0], f[1]) for f in structure._fields_)[member], self.byte.as_pointer()
        )
        return self._at(base, offset, kind)

    def _at(self, base: Any, offset: int, kind: Any) -> Any:
        address = self.builder.gep(base, [self.ir.Constant(self.ir.IntType(64), offset)], source_etype=self.byte)
        return self.builder.load(self.builder.bitcast(address, kind.as_pointer()), typ=kind)

    def _array(self, pointer: Any, shape: Sequence[Any], written: bool = False) -> Any:
        from numba.np.arrayobj import make_array, populate_array

        integer = self.ir.IntType(64)
        sizes = [self.ir.Constant(integer, part) if isinstance(part, int) else part for part in shape]
        strides: list[Any] = []
        step = self.ir.Constant(integer, 8)
        for size in reversed(sizes):
            strides.insert(0, step)
            step = self.builder.mul(step, size)
        kind = self.types.Array(self.types.float64, len(sizes), "C", readonly=not written)
        array = make_array(kind)(self.context, self.builder)
        data = self.builder.bitcast(pointer, self.ir.DoubleType().as_pointer())
        populate_array(array, data, sizes, strides, self.ir.Constant(integer, 8), None)
        return array._getvalue()

    def _numbers(self, base: Any, structure: type[ctypes.Structure], member: str, shape: Any, n: Any) -> Any:
        pointer = self._load(base, structure, member)
        return self._array(pointer, [n if isinstance(part, str) else part for part in shape])

    def _moved(self, base: Any, offset: int) -> Any:
        return self.builder.gep(base, [self.ir.Constant(self.ir.IntType(64), offset)], source_etype=self.byte)

    def _values(self, tick: Any) -> dict[str, Callable[[], Any]]:
        """How each argument is made, of pointers in the tick."""
        kinds, law, builder = _types(self.law), self.law, self.builder
        arms = self._load(tick, layout.CTick, "arms")
        arm_at = [self._moved(arms, i * ctypes.sizeof(layout.CArm)) for i in range(law.arms)]
        counts = [self._load(at, layout.CArm, "n") for at in arm_at]

        def pack(kind: Any, values: Sequence[Any]) -> Any:
            return self.context.make_tuple(builder, kind, values)

        def arm(i: int) -> Any:
            members = [
                self._numbers(arm_at[i], layout.CArm, name, layout.ARM_FIELDS[name].shape, counts[i])
                for name in law.arm_fields
            ]
            return pack(kinds["arm"], members)

        def torque(i: int) -> Any:
            return self._array(self._load(arm_at[i], layout.CArm, "tau"), [counts[i]], written=True)

        def inputs() -> Any:
            base, made = self._load(tick, layout.CTick, "inputs"), []
            for place, spec in enumerate(law.inputs.values()):
                at = self._moved(base, place * ctypes.sizeof(layout.CSetPoint))
                members = layout.SET_POINTS.get(spec.quantity)
                if members:
                    kind = kinds["inputs"].types[place]
                    parts = [
                        self._numbers(at, layout.CSetPoint, member, shape, counts[spec.arm])
                        for member, shape in members.values()
                    ]
                    made.append(pack(kind, parts))
                elif spec.quantity == "scalar":
                    made.append(self._at(self._load(at, layout.CSetPoint, "value"), 0, self.ir.DoubleType()))
                else:
                    made.append(self._numbers(at, layout.CSetPoint, "value", (6,), None))
            return pack(kinds["inputs"], made)

        def parameters() -> Any:
            base, made = self._load(tick, layout.CTick, "parameters"), []
            for place, spec in enumerate(law.parameters.values()):
                pointer = self._at(base, 8 * place, self.byte.as_pointer())
                if spec.size == 1:
                    made.append(self._at(pointer, 0, self.ir.DoubleType()))
                else:
                    made.append(self._array(pointer, [counts[0] if isinstance(spec.size, str) else spec.size]))
            return pack(kinds["parameters"], made)

        def numbers(member: str, sizes: Sequence[int | str]) -> Any:
            base, made, place = self._load(tick, layout.CTick, member), [], 0
            for size in sizes:
                at = self._moved(base, 8 * place)
                made.append(self._array(at, [counts[0] if isinstance(size, str) else size], written=True))
                place += layout.reserved(size)
            return pack(kinds[member], made)

        return {
            "arm": lambda: arm(0),
            "arms": lambda: pack(kinds["arms"], [arm(i) for i in range(law.arms)]),
            "tau": lambda: torque(0) if law.arms == 1 else pack(kinds["tau"], [torque(i) for i in range(law.arms)]),
            "inputs": inputs,
            "parameters": parameters,
            "outputs": lambda: numbers("outputs", list(law.outputs.values())),
            "memory": lambda: numbers("memory", list(law.memory.values())),
            "contact": lambda: pack(kinds["contact"], [self._load(tick, layout.CTick, m) for m in layout.CONTACT]),
            "dt": lambda: self._load(tick, layout.CTick, "dt"),
            "time_s": lambda: self._load(tick, layout.CTick, "time_s"),
        }


def _export(module: Any, law: layout.Declaration, pointers: dict[str, Any]) -> None:
    """The descriptor as constant data, and the function that the program calls for it."""
    from llvmlite import ir

    byte_pointer, u32, double = ir.IntType(8).as_pointer(), ir.IntType(32), ir.DoubleType()

    def data(value: Any, name: str) -> Any:
        made = ir.GlobalVariable(module, value.type, f"multipanda_{name}_{len(module.global_values)}")
        made.global_constant, made.linkage, made.initializer = True, "internal", value
        return made.bitcast(byte_pointer)

    def text(value: str) -> Any:
        encoded = bytearray(value.encode() + b"\0")
        return data(ir.Constant(ir.ArrayType(ir.IntType(8), len(encoded)), encoded), "text")

    def number(value: int) -> Any:
        return ir.Constant(u32, value)

    def real(value: float) -> Any:
        return ir.Constant(double, float(value))

    def table(rows: list[list[Any]], name: str) -> Any:
        if not rows:
            return ir.Constant(byte_pointer, None)
        made = [ir.Constant.literal_struct(row) for row in rows]
        return data(ir.Constant(ir.ArrayType(made[0].type, len(made)), made), name)

    def initial(spec: layout.LawParameter) -> tuple[Any, int]:
        values = layout.initial_of(spec)
        made = ir.Constant(ir.ArrayType(double, len(values)), [real(value) for value in values])
        return data(made, "initial"), len(values)

    parameters = []
    for name, spec in law.parameters.items():
        values, count = initial(spec)
        size = 0 if isinstance(spec.size, str) else spec.size
        row = [text(name), text(spec.unit), text(spec.doc), number(size), number(count), values]
        parameters.append([*row, real(spec.low), real(spec.high)])
    inputs = [
        [text(name), text(spec.doc), number(layout.QUANTITIES.index(spec.quantity)), number(spec.arm)]
        for name, spec in law.inputs.items()
    ]
    outputs = [[text(name), text(f"{name} of {law.type}."), number(size)] for name, size in law.outputs.items()]
    counts = [law.arms, law.flags, len(inputs), len(parameters), len(outputs), law.memory_size]
    nothing = ir.Constant(byte_pointer, None)
    functions = [pointers[kind].bitcast(byte_pointer) if kind in pointers else nothing for kind in ("start", "update")]
    row = [text(law.type), text(law.doc), *map(number, counts)]
    row += [table(inputs, "inputs"), table(parameters, "parameters"), table(outputs, "outputs"), *functions]
    structures = (layout.CLaw, layout.CParameter, layout.CInput, layout.COutput, layout.CArm, layout.CSetPoint)
    sizes = [ctypes.sizeof(structure) for structure in (*structures, layout.CTick)]
    head = [layout.VERSION, *sizes, 1, 0]
    whole = data(ir.Constant.literal_struct([*map(number, head), table([row], "law")]), "laws")
    function = ir.Function(module, ir.FunctionType(byte_pointer, []), "multipanda_laws")
    ir.IRBuilder(function.append_basic_block()).ret(whole)
