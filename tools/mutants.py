#!/usr/bin/env python3
"""Mutation test of the core: which small changes to its sources do its tests find?

    python3 -m venv /tmp/mutants.venv && /tmp/mutants.venv/bin/pip install libclang==18.1.1
    /tmp/mutants.venv/bin/python tools/mutants.py WORK --folders safety state --sample 150 --seed 1

All mutants are compiled at once, into a copy of the sources in WORK: an expression `a < b` becomes
`(mutants::on(17) ? (a <= b) : (a < b))`, a statement `f(x);` becomes `if (!mutants::on(18)) { f(x); }`. The
environment variable MUTANT chooses the one that acts. Each test case is run once to note which mutants it reaches; a
mutant is then run against the cases that reach it, quickest first, until one fails. A case that takes ten times as
long as usual counts as failed. Mutants in constant expressions never act and count as not reached.

Results: WORK/results.json, and a table with 95 % intervals (Wilson) of the share that is found.
"""

import argparse
import concurrent.futures
import json
import math
import os
import pathlib
import random
import re
import resource
import shutil
import subprocess
import sys

import clang.cindex as ci

ROOT = pathlib.Path(__file__).resolve().parent.parent
FOLDERS = ("safety", "modes", "cycle", "state", "reference", "controllets", "features")
# The core's own tests, and those of the project that hold its laws against worlds in simulated time.
TARGETS = (
    "core/core_test",
    "core/threads_test",
    "core/controllets_test",
    "core/force_controllets_test",
    "core/coupled_ufic_test",
    "core/modes_test",
    "tests/collision_approach_test",
    "tests/collision_objects_test",
    "tests/contact_press_test",
    "scene/scene_test",
    "tests/coupled_interaction_test",
    "tests/friction_compensation_test",
    "tests/hold_figures_test",
    "runtime/live_input_test",
)

SWITCH = """#pragma once
#include <cstdio>
#include <cstdlib>
#include <type_traits>
// Which mutant acts, and which ones were reached.
namespace mutants {
inline constexpr int kMost = 60000;
struct State {
  int chosen = std::getenv("MUTANT") ? std::atoi(std::getenv("MUTANT")) : 0;
  bool reached[kMost] = {};
  ~State() {
    const char* file = std::getenv("MUTANT_TRACE");
    if (file == nullptr) return;
    std::FILE* out = std::fopen(file, "w");
    for (int i = 0; i < kMost; ++i) {
      if (reached[i]) std::fprintf(out, "%d\\n", i);
    }
    std::fclose(out);
  }
};
__attribute__((visibility("default"))) inline State state;
inline bool runs(int id) {
  state.reached[id] = true;
  return state.chosen == id;
}
constexpr bool on(int id) { return !std::is_constant_evaluated() && runs(id); }
}  // namespace mutants
"""

RELATIONS = {"<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "==", "&&": "||", "||": "&&"}
# For real numbers `<` and `<=` differ at one point, which measured values do not hit.
RELATIONS_OF_REALS = {"<": ">=", "<=": ">", ">": "<=", ">=": "<"}
ARITHMETIC = {"+": "-", "-": "+", "*": "/", "/": "*", "&": "|", "|": "&"}
ASSIGNMENTS = {"+=": "-=", "-=": "+=", "*=": "/=", "/=": "*=", "|=": "&=", "&=": "|="}
BUILTIN = re.compile(r"^(const )?(bool|char|int|unsigned|long|float|double|std::u?int\d+_t|std::size_t|u?int\d+_t)\b")
K = ci.CursorKind
NAMES = (K.DECL_REF_EXPR, K.MEMBER_REF_EXPR, K.OVERLOADED_DECL_REF, K.TYPE_REF, K.TEMPLATE_REF)


class Edits:
    """Changes of one file: nested extents, each with functions that map its inner text to new text."""

    def __init__(self, text, first_id):
        self.text, self.next_id, self.mutants, self.nodes = text, first_id, [], {}

    def add(self, start, end, what, line, make):
        mutant = self.next_id
        self.next_id += 1
        self.mutants.append({"id": mutant, "line": line, "what": what})
        self.nodes.setdefault((start, end), []).append(lambda inner: make(mutant, inner))

    def apply(self):
        def render(start, end, nodes):
            out, at = [], start
            while nodes:
                (s, e), makes = nodes[0]
                inner = [n for n in nodes[1:] if n[0][1] <= e and n[0][0] >= s]
                text = render(s, e, inner)
                for make in reversed(makes):  # for equal extents the outer expression was added first
                    text = make(text)
                out += [self.text[at:s], text]
                at = e
                nodes = nodes[1 + len(inner) :]
            out.append(self.text[at:end])
            return b"".join(out)

        nodes = sorted(self.nodes.items(), key=lambda node: (node[0][0], -node[0][1]))
        return render(0, len(self.text), nodes)


def is_builtin(cursor):
    return bool(BUILTIN.match(cursor.type.spelling)) or bool(BUILTIN.match(cursor.type.get_canonical().spelling))


def operator_of(text, children):
    between = text[children[0].extent.end.offset : children[1].extent.start.offset].decode()
    return re.sub(r"[\s()]|//.*", "", between)


def find_mutants(path, text, unit, first_id):
    edits = Edits(text, first_id)

    def span(cursor):
        return cursor.extent.start.offset, cursor.extent.end.offset

    def swap(cursor, children, old, new):
        s, e = span(cursor)
        at = text.find(old.encode(), children[0].extent.end.offset, children[1].extent.start.offset)
        mutated = text[s:at] + new.encode() + text[at + len(old) : e]
        edits.add(
            s,
            e,
            f"{old} becomes {new}: {text[s:e].decode()[:70]}",
            cursor.location.line,
            lambda i, inner: b"(mutants::on(%d) ? (%s) : (%s))" % (i, mutated, inner),
        )

    def visit(cursor, parent, in_body):
        if cursor.location.file and cursor.location.file.name != str(path):
            return
        kind = cursor.kind
        if kind in (K.STATIC_ASSERT, K.ENUM_DECL, K.ALIGNED_ATTR):
            return
        if kind in (K.VAR_DECL, K.DECL_STMT) and any(t.spelling == "constexpr" for t in list(cursor.get_tokens())[:3]):
            return
        if kind in (K.FUNCTION_DECL, K.CXX_METHOD) and any(
            t.spelling == "consteval" for t in list(cursor.get_tokens())[:3]
        ):
            return
        s, e = span(cursor)
        if text[:s].rstrip().endswith(b"[[noreturn]]"):  # otherwise returning would be undefined behavior
            return
        children = list(cursor.get_children())
        line = cursor.location.line
        # Text of macros and cursors of other files have no extent in this file.
        sound = in_body and s < e and cursor.extent.start.file and cursor.extent.start.file.name == str(path)
        if sound and kind == K.BINARY_OPERATOR and len(children) == 2:
            op = operator_of(text, children)
            if op in RELATIONS and all(is_builtin(c) or c.type.kind.name == "ENUM" for c in children):
                real = any(c.type.get_canonical().kind in (ci.TypeKind.DOUBLE, ci.TypeKind.FLOAT) for c in children)
                swap(cursor, children, op, (RELATIONS_OF_REALS if real else {}).get(op, RELATIONS[op]))
            elif op in ARITHMETIC and is_builtin(cursor) and all(is_builtin(c) for c in children):
                swap(cursor, children, op, ARITHMETIC[op])
        if sound and kind == K.COMPOUND_ASSIGNMENT_OPERATOR and len(children) == 2 and is_builtin(cursor):
            op = operator_of(text, children)
            if op in ASSIGNMENTS:
                swap(cursor, children, op, ASSIGNMENTS[op])
        rewritten = text[s : s + 2] == b"!="  # for classes the parser shows `!(a == b)`
        if (
            sound
            and not rewritten
            and kind == K.UNARY_OPERATOR
            and text[s : s + 1] in (b"!", b"-")
            and is_builtin(cursor)
        ):
            operand = text[s + 1 : e]
            operand = b"static_cast<bool>(%s)" % operand if text[s : s + 1] == b"!" else operand
            edits.add(
                s,
                e,
                f"without its {text[s : s + 1].decode()}: {text[s:e].decode()[:70]}",
                line,
                lambda i, inner: b"(mutants::on(%d) ? (%s) : (%s))" % (i, operand, inner),
            )
        if sound and kind == K.IF_STMT and children and children[0].kind.is_expression():
            cs, ce = span(children[0])
            if cs < ce and text[ce : ce + 1] == b")":
                edits.add(
                    cs,
                    ce,
                    f"the opposite: if ({text[cs:ce].decode()[:70]})",
                    line,
                    lambda i, inner: b"(mutants::on(%d) != static_cast<bool>(%s))" % (i, inner),
                )
        # Template arguments are constants: no mutant could act.
        in_type = parent is not None and parent.kind == K.VAR_DECL and e <= parent.location.offset
        is_argument = in_type or (parent is not None and parent.kind in NAMES)
        literal = kind in (K.INTEGER_LITERAL, K.FLOATING_LITERAL) and not is_argument
        if sound and literal and re.match(rb"^[\d.][\d.eE+-]*$", text[s:e]):
            value = text[s:e].decode()
            new = "1" if float(value) == 0 else "0" if kind == K.INTEGER_LITERAL and value == "1" else f"2*{value}"
            edits.add(
                s,
                e,
                f"{value} becomes {new}",
                line,
                lambda i, inner: b"(mutants::on(%d) ? %s : %s)" % (i, new.encode(), inner),
            )
        is_statement = parent is not None and parent.kind == K.COMPOUND_STMT and kind.is_expression()
        reserves = b".reserve(" in text[s:e]  # affects memory allocation only
        if sound and is_statement and not reserves and text[e : e + 1] == b";":
            edits.add(
                s,
                e + 1,
                f"left out: {text[s:e].decode()[:70]}",
                line,
                lambda i, inner: b"if (!mutants::on(%d)) { %s }" % (i, inner),
            )
        for child in children:
            visit(child, cursor, in_body or kind in (K.COMPOUND_STMT, K.CXX_FOR_RANGE_STMT))

    visit(unit.cursor, None, False)
    return edits


def flags(build):
    """Include folders and definitions of one object of the core."""
    commands = subprocess.run(
        ["ninja", "-C", str(build), "-t", "commands", "core/libmultipanda_core.so"], capture_output=True, text=True
    ).stdout
    line = next(x for x in commands.splitlines() if "Unity/unity_0" in x or "core/safety" in x)
    found = re.findall(r"(-I\S+|-D\S+)|(-isystem) (\S+)", line)
    words = [w for a, b, c in found for w in ((a,) if a else (b, c))]
    gcc = subprocess.run(["c++", "-E", "-x", "c++", "-", "-v"], input="", capture_output=True, text=True).stderr
    system = re.search(r"search starts here:\n(.*?)End of search", gcc.split("<...>")[-1], re.S).group(1).split()
    words.append("-DEIGEN_DONT_VECTORIZE")  # intrinsics are specific to the compiler; another one does not know them
    return words + [w for folder in system if folder.startswith("/") for w in ("-isystem", folder)] + ["-std=c++20"]


def parsed_headers(index, tree, arguments):
    """The headers of others that the build precompiles, parsed once."""
    names = re.search(r"MULTIPANDA_PCH_HEADERS ([^)]*)\)", (tree / "cmake" / "targets.cmake").read_text())[1].split()
    names = [name for name in names if name.startswith("<")]  # mutants of our own must be seen where they are
    common, source = tree / "common.pch", tree / "common.hpp"
    source.write_text("".join(f"#include {name}\n" for name in names))
    index.parse(str(source), args=["-x", "c++-header", *arguments]).save(str(common))
    return common


def rewrite(tree, folders, arguments):
    index, mutants, rewritten = ci.Index.create(excludeDecls=True), [], {}
    common = parsed_headers(index, tree, arguments)
    for folder in folders:
        for path in mutated_sources(tree, [folder]):
            text = path.read_bytes()
            unit = index.parse(str(path), args=["-x", "c++", *arguments, "-include-pch", str(common)])
            errors = [d for d in unit.diagnostics if d.severity >= ci.Diagnostic.Error]
            if errors:
                print(f"{path.name}: not parsed, {errors[0].spelling}", file=sys.stderr)
                continue
            edits = find_mutants(path, text, unit, len(mutants) + 1)
            for mutant in edits.mutants:
                mutants.append({**mutant, "folder": folder, "file": path.name})
            if not edits.mutants:
                continue
            changed = edits.apply()
            include = b'#include "core/mutants.hpp"\n'
            head = b"#pragma once\n"
            changed = head + include + changed.replace(head, b"", 1) if head in changed else include + changed
            rewritten[path] = changed
    for path, changed in rewritten.items():  # last: a header is parsed with the files that include it
        path.write_bytes(changed)
    (tree / "core" / "mutants.hpp").write_text(SWITCH)
    return mutants


def wilson(found, total):
    if total == 0:
        return 0.0, 1.0
    z, p = 1.96, found / total
    middle, width = p + z * z / (2 * total), z * math.sqrt(p * (1 - p) / total + z * z / (4 * total * total))
    return (middle - width) / (1 + z * z / total), (middle + width) / (1 + z * z / total)


def cases_of(program):
    listing = subprocess.run([program, "--gtest_list_tests"], capture_output=True, text=True).stdout
    suite = ""
    for line in listing.splitlines():
        if line.startswith("  "):
            yield suite + line.split("#")[0].strip()
        elif line.endswith(".") or ".  #" in line:
            suite = line.split("#")[0].strip()


def run_case(program, case, environment, limit_s):
    """Whether it passed within limit_s of processor time, which excludes the load of other programs."""
    command = ["prlimit", f"--cpu={math.ceil(limit_s)}", program, f"--gtest_filter={case}"]
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    try:  # a waiting test uses no processor time
        return (
            subprocess.run(command, env={**os.environ, **environment}, timeout=60 + 20 * limit_s, **silent).returncode
            == 0
        )
    except subprocess.TimeoutExpired:
        return False


def mutated_sources(root, folders):
    for folder in folders:
        for path in sorted((root / "core" / folder).glob("*.[ch]pp")):
            if not path.stem.endswith("_test"):
                yield path


def prepare(tree, build, folders):
    """A copy of the sources with all mutants; returns these."""
    shutil.rmtree(tree, ignore_errors=True)
    ignore = shutil.ignore_patterns("build", "build-*", ".git", ".venv", "runs", "__pycache__", "dist")
    shutil.copytree(ROOT, tree, ignore=ignore)
    (tree / ".venv").symlink_to(ROOT / ".venv")
    # As in sanitizer builds: reading a vector out of bounds ends the program.
    # A mutant may make a number narrower in braces, which Clang refuses and GCC permits.
    flags_of_build = "-w -Wno-c++11-narrowing -Wno-narrowing -O1 -D_GLIBCXX_ASSERTIONS"
    configure = ["cmake", "-S", tree, "-B", build, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=None", "-DMULTIPANDA_PCH=ON"]
    subprocess.run([*configure, f"-DCMAKE_CXX_FLAGS={flags_of_build}", "-DMULTIPANDA_WERROR=OFF"], check=True)
    return rewrite(tree, folders, [a.replace(str(ROOT), str(tree)) for a in flags(build)])


def take_tests(tree):
    """Newest tests first, for mutants that no test has found so far."""
    paths = [
        *(ROOT / "core").rglob("*_test.cpp"),
        *(ROOT / "core" / "testing").iterdir(),
        *(ROOT / "tests").rglob("*.[ch]pp"),
        *(ROOT / "tests").rglob("CMakeLists.txt"),
        *(ROOT / "docs").rglob("*.md"),
        ROOT / "core" / "CMakeLists.txt",
    ]
    for path in paths:
        copy = tree / path.relative_to(ROOT)
        if not copy.exists() or copy.read_bytes() != path.read_bytes():
            shutil.copyfile(path, copy)


def cases_by_mutant(build, targets, trace):
    """Cases that reach each mutant, quickest first, as (processor time, program, case)."""
    reaching = {}
    for target in targets:
        program = str(build / target)
        for case in cases_of(program):
            trace.unlink(missing_ok=True)
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            if not run_case(program, case, {"MUTANT_TRACE": str(trace)}, 120):
                print(f"left out, it fails without any mutant: {case}", file=sys.stderr)
                continue
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            for mutant in map(int, trace.read_text().split()):
                reaching.setdefault(mutant, []).append((seconds, program, case))
    return {mutant: sorted(cases) for mutant, cases in reaching.items()}


def finder(mutant, cases, found_last):
    """The name of the first case that fails with the mutant; "" if all pass. Those that found its neighbors first."""
    last = found_last.setdefault(mutant["file"], [])
    order = sorted(cases, key=lambda case: (last.index(case[2]) if case[2] in last else len(last), case[0]))
    for seconds, program, case in order:
        if not run_case(program, case, {"MUTANT": str(mutant["id"])}, 2 + 10 * seconds):
            found_last[mutant["file"]] = [case, *(name for name in last if name != case)][:4]
            return case
    return ""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", type=pathlib.Path, help="folder for the copy and the results; kept")
    parser.add_argument("--folders", nargs="+", default=list(FOLDERS), choices=FOLDERS, metavar="FOLDER")
    parser.add_argument("--only", default="", help="mutants of files whose names begin so, as in --only force_law")
    parser.add_argument("--targets", nargs="+", default=list(TARGETS), help="test programs to run")
    parser.add_argument("--sample", type=int, default=150, help="mutants per folder; 0: all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    work = options.work.resolve()
    tree, build, list_file, results_file = work / "tree", work / "build", work / "mutants.json", work / "results.json"
    sources = {str(p.relative_to(ROOT)): p.read_text() for p in mutated_sources(ROOT, FOLDERS)}
    if not list_file.exists():
        mutants = prepare(tree, build, FOLDERS)
        list_file.write_text(json.dumps({"sources": sources, "mutants": mutants}))
    stored = json.loads(list_file.read_text())
    if stored["sources"] != sources:
        sys.exit(f"the sources changed since {work} was made: use an empty folder")
    mutants = stored["mutants"]
    take_tests(tree)
    subprocess.run(["ninja", "-C", build, f"-j{options.jobs}", *options.targets], check=True)

    reaching = cases_by_mutant(build, options.targets, work / "trace")
    results = json.loads(results_file.read_text()) if results_file.exists() else {}
    found_last = {}  # by file: cases that found its latest mutants
    for folder in options.folders:
        every = [m for m in mutants if m["folder"] == folder and m["file"].startswith(options.only)]
        size = min(options.sample or len(every), len(every))
        sample = random.Random(f"{options.seed} {folder}").sample(every, size)
        open_ones = [m for m in sample if not results.get(str(m["id"]))]
        with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
            found = pool.map(lambda m: finder(m, reaching.get(m["id"], []), found_last), open_ones)
            for mutant, by in zip(open_ones, found):
                results[str(mutant["id"])] = by
                results_file.write_text(json.dumps(results, indent=1))
        finders = {name for m in sample if (name := results[str(m["id"])])}
        places = {case[2]: case[1] for cases in reaching.values() for case in cases}
        for name in sorted(finders & places.keys()):
            if not run_case(places[name], name, {}, 120):
                sys.exit(f"{name} fails without any mutant now: remove {results_file} and start again")
        alive = sorted((m for m in sample if not results[str(m["id"])]), key=lambda m: m["id"])
        for m in alive:
            how = "survived" if m["id"] in reaching else "not reached"
            print(f"  {m['id']} {how}: core/{folder}/{m['file']}:{m['line']}: {m['what']}")
        found, total = len(sample) - len(alive), len(sample)
        low, high = wilson(found, total)
        share = f"{100 * found / max(total, 1):.1f} % ({100 * low:.1f} to {100 * high:.1f})"
        print(f"{folder}: {found} of {total} found, {share}; {len(every)} mutants in all", flush=True)


if __name__ == "__main__":
    main()
