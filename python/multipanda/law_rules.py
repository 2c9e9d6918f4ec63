"""What a law may contain: checked in its source, before anything is compiled. Every refusal names file and line."""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import textwrap
import types
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NoReturn

import numpy as np

from .errors import Refused

_ALLOCATES = "it allocates memory, which the loop never does; write into tau, outputs or declared memory"
_CALLS_PYTHON = "it needs Python, which the loop never calls"
_NODES: dict[type[ast.AST], str] = {
    ast.While: "a while loop has no bound; write for ... in range(N) with a constant N, and break",
    ast.ListComp: _ALLOCATES,
    ast.SetComp: _ALLOCATES,
    ast.DictComp: _ALLOCATES,
    ast.GeneratorExp: _ALLOCATES,
    ast.List: f"a list: {_ALLOCATES}; a tuple (a, b) needs no memory",
    ast.Set: f"a set: {_ALLOCATES}",
    ast.Dict: f"a dictionary: {_ALLOCATES}",
    ast.JoinedStr: f"a formatted text: {_ALLOCATES}",
    ast.Try: f"try: {_CALLS_PYTHON}; an exception of a law is a fault, and its arms are held",
    ast.With: f"with: {_CALLS_PYTHON}",
    ast.Lambda: "a function in a law; define it outside, under a name",
    ast.FunctionDef: "a function in a law; define it outside, under a name",
    ast.AsyncFunctionDef: f"async: {_CALLS_PYTHON}",
    ast.ClassDef: f"a class: {_CALLS_PYTHON}",
    ast.Yield: "a generator has no bound",
    ast.YieldFrom: "a generator has no bound",
    ast.Await: f"await: {_CALLS_PYTHON}",
    ast.Global: "a law has no state but its declared memory",
    ast.Nonlocal: "a law has no state but its declared memory",
    ast.Import: "an import in a law; import outside",
    ast.ImportFrom: "an import in a law; import outside",
    ast.MatMult: f"the operator @: {_ALLOCATES}, and calls a library; add_product and add_transposed_product of "
    "multipanda.law_math take its place",
}
_ALLOWED = (
    *(ast.Assign, ast.AugAssign, ast.AnnAssign, ast.For, ast.If, ast.Expr, ast.Return, ast.Pass, ast.Break),
    *(ast.Continue, ast.Raise, ast.Assert, ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.IfExp, ast.Call),
    *(ast.Attribute, ast.Subscript, ast.Slice, ast.Name, ast.Constant, ast.Tuple, ast.keyword, ast.operator),
    *(ast.unaryop, ast.boolop, ast.cmpop, ast.expr_context),
)
_BUILTINS = {"abs", "bool", "divmod", "enumerate", "float", "int", "len", "max", "min", "pow", "range", "round", "zip"}
_NUMPY = set(
    "abs absolute all any arccos arccosh arcsin arcsinh arctan arctan2 arctanh bool_ ceil copysign cos cosh deg2rad e "
    "exp exp2 expm1 fabs float64 floor fmax fmin hypot inf int64 isfinite isinf isnan log log10 log1p log2 max maximum "
    "min minimum mod nan pi power prod rad2deg radians degrees sign sin sinh sqrt square sum tan tanh trunc".split()
)
_MOST_CONSTANT_BYTES = 100_000


def refuse(place: str, why: str, next_step: str = "docs/python_laws.md says what a law may contain") -> NoReturn:
    """Raises Refused with the reason."""
    raise Refused("law_refused", f"{place}: {why}", next_step)


@dataclass
class Function:
    """The source of a function of a law: the law itself, or one that it calls."""

    name: str
    file: str
    tree: ast.FunctionDef  # line numbers are those of the file
    names: dict[str, Any] = field(default_factory=dict)  # what it uses from outside; functions are in `calls`
    calls: dict[str, Function] = field(default_factory=dict)
    constants: dict[str, Any] = field(default_factory=dict)  # by their names in the source: "settings.GAIN"

    def place(self, node: ast.AST) -> str:
        """File and line."""
        return f"{self.file}:{getattr(node, 'lineno', self.tree.lineno)}"

    def all(self) -> Iterator[Function]:
        """The functions that it calls, then itself."""
        for called in self.calls.values():
            yield from called.all()
        yield self

    @property
    def attributes(self) -> set[str]:
        """Names of all attributes, in it and in what it calls."""
        return {n.attr for f in self.all() for n in ast.walk(f.tree) if isinstance(n, ast.Attribute)}


def read(function: Callable[..., Any], calling: tuple[Callable[..., Any], ...] = ()) -> Function:
    """Reads and checks a function and all that it calls.

    Raises:
        Refused: It contains something that the loop must not do, with file and line.
    """
    code = function.__code__
    file = code.co_filename
    try:
        lines, first = inspect.getsourcelines(function)
    except (OSError, TypeError):
        refuse(file, f"the source of {function.__name__} cannot be read", "define the law in a file or a notebook")
    module = ast.parse(textwrap.dedent("".join(lines)))
    ast.increment_lineno(module, max(first, 1) - 1)
    tree = module.body[0]
    if not isinstance(tree, ast.FunctionDef):
        refuse(f"{file}:{first}", "expected a function: def name(arm, ..., tau)")
    tree.decorator_list = []
    found = Function(function.__name__, file, tree)
    if function in calling:
        refuse(found.place(tree), f"{function.__name__} calls itself: a recursion has no bound")
    _check_nodes(found)
    _resolve(found, function, (*calling, function))
    _Loops(found).check()
    return found


def _check_nodes(function: Function) -> None:
    arguments = function.tree.args
    if arguments.vararg or arguments.kwarg:
        refuse(function.place(function.tree), "*arguments: name each argument")
    for part in (*arguments.args, *arguments.kwonlyargs):
        part.annotation = None
    function.tree.returns = None
    for statement in function.tree.body:
        for node in ast.walk(statement):
            for kind, why in _NODES.items():
                if isinstance(node, kind):
                    place = node if hasattr(node, "lineno") else statement
                    if kind is ast.MatMult:
                        place = next(n for n in ast.walk(statement) if getattr(n, "op", None) is node)
                    refuse(function.place(place), why)
            if not isinstance(node, _ALLOWED):
                refuse(function.place(node), f"{type(node).__name__} is not possible in a law: {_CALLS_PYTHON}")


def _module_part(function: Function, node: ast.AST, value: Any, text: str) -> Any:
    """The value of module.name, for modules whose members are known."""
    assert isinstance(node, ast.Attribute)
    known = {"math": set(vars(math)), "numpy": _NUMPY}.get(value.__name__)
    if known is not None and node.attr not in known:
        refuse(
            function.place(node),
            f"{text} is not possible in a law: it allocates, calls Python, or is not one number's function",
            "write it as a loop over the elements; multipanda.law_math has products with matrices",
        )
    if not hasattr(value, node.attr):
        refuse(function.place(node), f"there is no {text}")
    return getattr(value, node.attr)


def _check_value(function: Function, node: ast.AST, value: Any, text: str) -> None:
    numbers = (bool, int, float, np.number, np.bool_)
    if value is None or isinstance(value, (numbers, str)):
        return
    if isinstance(value, type) and issubclass(value, (BaseException, *numbers)):
        return
    if isinstance(value, tuple) and all(isinstance(part, numbers) for part in value):
        return
    if isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
        if value.nbytes <= _MOST_CONSTANT_BYTES:
            return
        refuse(function.place(node), f"{text} has {value.nbytes} bytes; a constant has {_MOST_CONSTANT_BYTES} at most")
    if (getattr(value, "__module__", "") or "").split(".")[0] in ("math", "numpy") or isinstance(value, np.ufunc):
        return
    refuse(
        function.place(node),
        f"{text} is {type(value).__name__!r}: a law can use numbers, tuples and arrays of numbers, math, numpy's "
        "functions of numbers, and functions in Python",
        "use a tuple or an array in place of a list; use a parameter, an input or declared memory for values that "
        "change",
    )


def _resolve(function: Function, given: Callable[..., Any], calling: tuple[Callable[..., Any], ...]) -> None:
    """Finds the values of all names from outside."""
    code = given.__code__
    outside = dict(given.__globals__)
    for name, cell in zip(code.co_freevars, given.__closure__ or (), strict=True):
        outside[name] = cell.cell_contents
    local = {a.arg for a in (*function.tree.args.args, *function.tree.args.kwonlyargs)}
    local |= {n.id for n in ast.walk(function.tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    parents = {child: node for node in ast.walk(function.tree) for child in ast.iter_child_nodes(node)}
    for node in ast.walk(function.tree):
        if not isinstance(node, ast.Name):
            continue
        name = node.id
        if name in _BUILTINS and (name in local or name in outside):  # loop bounds rely on the built-in meaning
            refuse(function.place(node), f"{name} hides a Python name; rename it")
        if name in local:
            continue
        if name not in outside:
            if name not in _BUILTINS and not _is_exception(name):
                known = hasattr(builtins, name)
                refuse(function.place(node), f"{name}: {_CALLS_PYTHON if known else 'this name is not defined'}")
            continue
        value, part, text = outside[name], node, name
        function.names[name] = value
        while isinstance(value, types.ModuleType):
            attribute = parents[part]
            if not isinstance(attribute, ast.Attribute):
                refuse(function.place(node), f"{text} is a module")
            text = f"{text}.{attribute.attr}"
            value, part = _module_part(function, attribute, value, text), attribute  # type: ignore[assignment]
        plain = getattr(value, "py_func", value)  # a function that Numba has compiled already
        if isinstance(plain, types.FunctionType) and plain.__module__.split(".")[0] != "numpy":
            if part is not node:
                refuse(function.place(node), f"{text}: import the function itself: from ... import {plain.__name__}")
            if name not in function.calls:
                function.calls[name] = read(plain, calling)
        else:
            _check_value(function, node, value, text)
            function.constants[text] = value


def _is_exception(name: str) -> bool:
    value = getattr(builtins, name, None)
    return isinstance(value, type) and issubclass(value, Exception)


class _Loops:
    """Loops go over arrays, tuples, and ranges whose length follows from constants and from sizes of arrays."""

    def __init__(self, function: Function) -> None:
        self.function = function
        self.seen: set[ast.AST] = set()  # the names range, enumerate and zip of loops that were checked
        self.sources: dict[str, list[ast.expr | None]] = {}  # expressions assigned to each local name; None: any
        for node in ast.walk(function.tree):
            if isinstance(node, ast.Assign):
                for target in node.targets:
                    self._bind(target, node.value)
            elif isinstance(node, ast.AnnAssign) and node.value is not None:
                self._bind(node.target, node.value)
            elif isinstance(node, ast.AugAssign):
                self._bind(node.target, None)
            elif isinstance(node, ast.For):
                self._bind_loop(node)
        for argument in (*function.tree.args.args, *function.tree.args.kwonlyargs):
            self.sources.setdefault(argument.arg, []).append(None)

    def _bind(self, target: ast.expr, value: ast.expr | None) -> None:
        if isinstance(target, ast.Name):
            self.sources.setdefault(target.id, []).append(value)
        elif isinstance(target, ast.Tuple):
            parts = value.elts if isinstance(value, ast.Tuple) else [None] * len(target.elts)
            for part, its in zip(target.elts, parts, strict=False):
                self._bind(part, its)

    def _bind_loop(self, node: ast.For) -> None:
        kind = self._called(node.iter)
        targets = node.target.elts if isinstance(node.target, ast.Tuple) else [node.target]
        for place, target in enumerate(targets):
            counts = kind == "range" or (kind == "enumerate" and place == 0)
            self._bind(target, ast.Constant(0) if counts else None)  # bounded, as its loop is

    @staticmethod
    def _called(node: ast.expr) -> str:
        return node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""

    def check(self) -> None:
        """Refuses the first loop without a bound, and ranges that would get to a loop unseen."""
        for node in ast.walk(self.function.tree):
            if isinstance(node, ast.For):
                self._check_iterated(node, node.iter)
        for node in ast.walk(self.function.tree):
            if isinstance(node, ast.Name) and node.id in ("range", "enumerate", "zip") and node not in self.seen:
                refuse(self.function.place(node), f"{node.id} outside of a loop; write for ... in {node.id}(...)")

    def _check_iterated(self, loop: ast.For, node: ast.expr) -> None:
        called = self._called(node)
        if called in ("range", "enumerate", "zip"):
            assert isinstance(node, ast.Call)
            self.seen.add(node.func)
        if called == "range":
            assert isinstance(node, ast.Call)
            for argument in node.args:
                if not self.bounded(argument, frozenset()):
                    refuse(
                        self.function.place(loop),
                        f"range({ast.unparse(argument)}) has no bound that is known before the law runs",
                        "use a constant, len() or a shape; a loop that ends earlier uses break",
                    )
        elif called in ("enumerate", "zip"):
            assert isinstance(node, ast.Call)
            for argument in node.args:
                self._check_iterated(loop, argument)
        elif not isinstance(node, (ast.Name, ast.Attribute, ast.Subscript, ast.Tuple)):
            refuse(self.function.place(loop), f"a loop over {ast.unparse(node)}: its length is not known")

    def bounded(self, node: ast.expr, within: frozenset[str]) -> bool:
        """Whether a number follows from constants and sizes."""
        if isinstance(node, ast.Constant):
            return isinstance(node.value, int)
        if isinstance(node, ast.UnaryOp):
            return self.bounded(node.operand, within)
        if isinstance(node, ast.BinOp):
            return self.bounded(node.left, within) and self.bounded(node.right, within)
        if isinstance(node, ast.Call):
            called = self._called(node)
            return called == "len" or (called in ("min", "max") and all(self.bounded(a, within) for a in node.args))
        if isinstance(node, ast.Subscript):
            return isinstance(node.value, ast.Attribute) and node.value.attr == "shape"
        if isinstance(node, ast.Attribute):
            if node.attr in ("size", "ndim"):
                return True
            return isinstance(node.value, ast.Name) and isinstance(self._constant(node), (int, np.integer))
        if isinstance(node, ast.Name):
            if node.id in within:
                return False  # depends on itself
            if node.id in self.sources:
                sources = self.sources[node.id]
                return all(s is not None and self.bounded(s, within | {node.id}) for s in sources)
            return isinstance(self.function.names.get(node.id), (int, np.integer))
        return False

    def _constant(self, node: ast.Attribute) -> Any:
        assert isinstance(node.value, ast.Name)
        module = self.function.names.get(node.value.id)
        return getattr(module, node.attr, None) if isinstance(module, types.ModuleType) else None
