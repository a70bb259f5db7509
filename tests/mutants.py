"""Mutation testing: random small changes of the sources, and whether the tests detect them.

    python tests/mutants.py --package contact tick --count 40

A mutant is one change in one function: a comparison reversed, + replaced by -, a call removed. Each is made in a copy
of the checkout, and the test files nearest to its module run there until one fails: the file that mirrors the module,
those that import it, those of modules that import it. The gate alone decides; with `--nightly` also `tests/nightly`
and the tests marked `nightly`. For a mutant that no test detects, write the test, or give the reason in
`tests/equivalent_mutants.toml` why the change has no visible effect.

Not changed: text, annotations, decorators, what is raised or warned, `__repr__`, and constants outside functions.
Why no library: mutmut skips decorated functions, which is all compiled code, and cosmic-ray runs one command for all
modules, in the checkout itself.
"""

import argparse
import ast
import contextlib
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
import tomllib
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

ROOT: Final = Path(__file__).resolve().parents[1]
EQUIVALENT: Final = ROOT / "tests" / "equivalent_mutants.toml"
PACKAGES: Final = {"hapscene": "hapscene", "plugins": "hapscene_plugins"}
"""Folders whose modules are changed, and their import names."""
LINKS: Final = PACKAGES | {name: f"hapscene_{name}" for name in ("assets", "swatches", "evidence")}
PATIENCE_S: Final = 60.0
"""Time limit of a run beyond five times its unchanged time [s]: the changed function is compiled again."""

OPERATORS: Final = {
    **{ast.Lt: ("<", ">="), ast.LtE: ("<=", ">"), ast.Gt: (">", "<="), ast.GtE: (">=", "<"), ast.Eq: ("==", "!=")},
    **{ast.NotEq: ("!=", "=="), ast.Is: ("is", "is not"), ast.IsNot: ("is not", "is"), ast.In: ("in", "not in")},
    **{ast.NotIn: ("not in", "in"), ast.And: ("and", "or"), ast.Or: ("or", "and"), ast.Add: ("+", "-")},
    **{ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*"), ast.BitAnd: ("&", "|"), ast.BitOr: ("|", "&")},
}
"""How an operator is written, and its replacement."""
FAILED: Final = re.compile(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", re.MULTILINE)
EXTREMES: Final = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum"}


class Mutant(NamedTuple):
    """A change of one file: the bytes from `start` to `end` become `new`."""

    kind: str
    file: str
    line: int
    was: str  # the changed lines, without indentation
    now: str
    start: int
    end: int
    new: str

    @property
    def package(self) -> str:
        parts = Path(self.file).with_suffix("").parts
        return parts[1] if parts[0] == "hapscene" else parts[0]

    @property
    def key(self) -> tuple[str, str, str]:
        """Identity that does not depend on the line number."""
        return self.file, self.was, self.now


# --- mutants of a file


def mutants_of(file: Path) -> Iterator[Mutant]:
    """All mutants of one file."""
    text = file.read_bytes()
    starts = [0, *(at.end() for at in re.finditer(rb"\n", text))]
    name = file.relative_to(ROOT).as_posix()
    for node in ast.parse(text).body:
        for kind, begin, end, symbol, new in _below(node) if isinstance(node, ast.FunctionDef | ast.ClassDef) else ():
            a, b = (starts[line - 1] + column for line, column in (begin, end))
            if symbol:  # there may be brackets between the operands
                at = re.search(rb"(?<![\w*/])" + re.escape(symbol.encode()) + rb"(?![\w*/])", text[a:b])
                a, b = (a + at.start(), a + at.end()) if at else (0, 0)
            if b > 0:
                first, last = text.rfind(b"\n", 0, a) + 1, text.find(b"\n", b)
                now = text[first:a] + new.encode() + text[b:last]
                lines = (" ".join(line.decode().split()) for line in (text[first:last], now))
                yield Mutant(kind, name, begin[0], *lines, a, b, new)


_Change = tuple[str, tuple[int, int], tuple[int, int], str, str]


def _below(node: ast.AST) -> Iterator[_Change]:
    """Changes in and below a node: kind, begin, end, the symbol to find between them, the replacement."""
    if (
        isinstance(node, ast.Raise | ast.JoinedStr | ast.Assert)
        or (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
        or getattr(node, "name", "") == "__repr__"
        or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
        or (isinstance(node, ast.Call) and "warn" in _called(node))
    ):
        return
    yield from _at(node)
    for name, value in ast.iter_fields(node):
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and name not in ("annotation", "returns", "decorator_list", "bases"):
                yield from _below(child)


def _called(call: ast.Call) -> str:
    return call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")


def _at(node: Any) -> Iterator[_Change]:
    if isinstance(node, ast.Compare):
        for op, left, right in zip(node.ops, [node.left, *node.comparators], node.comparators, strict=False):
            yield "comparison", _end(left), _start(right), *OPERATORS[type(op)]
    elif isinstance(node, ast.BoolOp):
        for left, right in zip(node.values, node.values[1:], strict=False):
            yield "and, or", _end(left), _start(right), *OPERATORS[type(node.op)]
    elif isinstance(node, ast.BinOp) and type(node.op) in OPERATORS and not _is_text(node):
        yield "operator", _end(node.left), _start(node.right), *OPERATORS[type(node.op)]
    elif isinstance(node, ast.AugAssign) and type(node.op) in OPERATORS and not _is_text(node):
        was, now = OPERATORS[type(node.op)]
        yield "assignment", _end(node.target), _start(node.value), f"{was}=", f"{now}="
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        yield "not, minus", _start(node), _start(node.operand), "not" if isinstance(node.op, ast.Not) else "-", ""
    elif isinstance(node, ast.Constant) and type(node.value) in (bool, int, float):
        yield "constant", _start(node), _end(node), "", _other(node.value)
    elif isinstance(node, ast.Call) and _called(node) in EXTREMES:
        yield "min, max", _start(node.func), _end(node.func), _called(node), EXTREMES[_called(node)]
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        yield "call", _start(node), _end(node), "", "pass"
    elif isinstance(node, ast.FunctionDef) and getattr(node.returns, "id", "") == "bool":
        for inner in ast.walk(node):
            if isinstance(inner, ast.Return) and not isinstance(inner.value, ast.Compare | ast.Constant | None):
                yield "return", _start(inner), _end(inner), "", f"return not ({ast.unparse(inner.value)})"


def _start(node: Any) -> tuple[int, int]:
    return node.lineno, node.col_offset


def _end(node: Any) -> tuple[int, int]:
    return node.end_lineno, node.end_col_offset


def _is_text(node: ast.AST) -> bool:
    return any(isinstance(getattr(inner, "value", 0), str | bytes) for inner in ast.walk(node))


def _other(value: float) -> str:
    if isinstance(value, float):
        return f"({-value!r})" if value else "1.0"
    return str(not value) if isinstance(value, bool) else str(value - 1 if value > 0 else 1)


# --- the tests for a mutant


@cache
def imports(file: Path) -> frozenset[str]:
    """Modules of the project that a file imports, as paths from the root; public names are resolved by the stubs."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Attribute) and ast.unparse(node).startswith("hapscene."):
            names.add(ast.unparse(node))
    return frozenset(path for name in names for path in _paths(name)) - {file.relative_to(ROOT).as_posix()}


def _paths(name: str) -> Iterator[str]:
    for folder, package in PACKAGES.items():
        if name.split(".")[0] == package:
            path = Path(folder, *name.split(".")[1:])
            if (ROOT / path).with_suffix(".py").is_file():
                yield path.with_suffix(".py").as_posix()
            elif (stub := ROOT / path.parent / "__init__.pyi").is_file():
                line = re.search(rf"^from \.([\w.]+) import {path.name} as", stub.read_text(encoding="utf-8"), re.M)
                yield from _paths(".".join((package, *path.parent.parts[1:], line[1])) if line else "")


def tests_for(mutant: Mutant, nightly: bool) -> list[str]:
    """Test files that reach a module, the nearest first; with `nightly`, those of `tests/nightly` come last."""
    away, wave, steps = {mutant.file: 0}, {mutant.file}, 0
    modules = [path for folder in PACKAGES for path in sorted((ROOT / folder).rglob("*.py"))]
    while wave:
        steps += 1
        wave = {p for m in modules if (p := m.relative_to(ROOT).as_posix()) not in away and imports(m) & wave}
        away |= dict.fromkeys(wave, steps)
    mirrors = {f"test_{Path(file).stem}": steps - 0.5 for file, steps in reversed(away.items())}
    ranked = []
    for test in sorted((ROOT / "tests").rglob("test_*.py")):
        name = test.relative_to(ROOT)
        at_night = "nightly" in name.parts
        if at_night and not nightly:
            continue
        far = min([away[file] for file in imports(test) if file in away] + [mirrors.get(test.stem, 99.0)])
        at_home = mutant.package in name.parts
        if far < 99.0 or at_home:
            ranked.append((at_night, far, not at_home, name.as_posix()))
    return [test for *_, test in sorted(ranked)]


# --- running the tests


class Worker:
    """A copy of the checkout with its own compile cache; it tries one mutant at a time."""

    def __init__(self, folder: Path, stop: threading.Event, nightly: bool) -> None:
        self.marks = ["-m", "not soak"] if nightly else []  # the gate deselects what is marked nightly
        self.tree, self.links, self.cache, self.stop = folder / "tree", folder / "links", folder / "numba", stop
        self.process: subprocess.Popen[bytes] | None = None
        self.clean: dict[str, tuple[float, list[str]]] = {}
        shutil.rmtree(self.tree, ignore_errors=True)
        listed = subprocess.run(["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, stdout=-1, check=True)
        for name in filter(lambda name: (ROOT / name).is_file(), listed.stdout.decode().splitlines()):
            (self.tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, self.tree / name)  # with its time, on which the compile cache depends
        self.links.mkdir(exist_ok=True)
        to = {folder / "shared": ROOT.parent / "shared"}
        to |= {self.links / package: self.tree / name for name, package in LINKS.items()}
        for link, target in to.items():
            if target.exists() and not link.is_symlink():
                link.symlink_to(target)
        subprocess.run([sys.executable, "-m", "compileall", "-q", self.tree], check=True, stdout=-3)
        self._seed()
        self.known = set(self.cache.glob("hapscene/*"))

    def _seed(self) -> None:
        """Copy the compile cache: its files are named by the code, wherever the source is."""
        from hapscene.compiled.cache import cache_folder

        (self.cache / "hapscene").mkdir(0o700, parents=True, exist_ok=True)
        folder = cache_folder()
        for file in folder.glob("*.nbc") if folder else ():
            shutil.copy2(file, self.cache / "hapscene" / file.name)

    def pytest(self, test: str, limit_s: float, *options: str) -> tuple[int | None, str]:
        """Exit code (None: time limit reached) and output of one test file."""
        if self.stop.is_set():
            return None, ""
        own = {"PYTHONPATH": str(self.links), "NUMBA_CACHE_DIR": str(self.cache), "PYTHONDONTWRITEBYTECODE": "1"}
        command = [sys.executable, "-P", "-m", "pytest", "-p", "no:cacheprovider", "--timeout=0", "--tb=no", "-rfE"]
        command += [*self.marks, *options, test]
        self.process = subprocess.Popen(
            command, cwd=self.tree, env=os.environ | own, stdin=-3, stdout=-1, stderr=-2, start_new_session=True
        )
        try:
            out, _ = self.process.communicate(timeout=limit_s)
            return self.process.returncode, out.decode(errors="replace")
        except subprocess.TimeoutExpired:
            return None, ""
        finally:
            self.kill()

    def kill(self) -> None:
        """End the running tests and all processes that they started."""
        if self.process is not None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()

    def unchanged(self, test: str, budget_s: float) -> tuple[float, list[str]]:
        """Time of a test file without any change [s], and options that deselect the tests that fail even so."""
        while test not in self.clean:
            start = time.monotonic()
            code, out = self.pytest(test, PATIENCE_S + 5.0 * budget_s)
            compiled = set(self.cache.glob("hapscene/*"))
            if compiled == self.known or code is None:  # else again: this time it compiles nothing
                options = [f"--deselect={name}" for name in FAILED.findall(out)]
                self.clean[test] = time.monotonic() - start, options if code in (0, 1) else [f"--ignore={test}"]
            self.known = compiled
        return self.clean[test]

    def attempt(self, mutant: Mutant, budget_s: float, nightly: bool) -> dict[str, Any]:
        """Try one mutant on its nearest tests, as many as take `budget_s` unchanged, at least one."""
        ran: list[str] = []
        file, spent_s = self.tree / mutant.file, 0.0
        text, times = file.read_bytes(), file.stat()
        for test in tests_for(mutant, nightly):
            if not (self.tree / test).is_file():  # written after the copy was made
                continue
            took_s, options = self.unchanged(test, budget_s)
            if ran and spent_s + took_s > budget_s:
                break
            spent_s += took_s
            ran.append(test)
            file.write_bytes(text[: mutant.start] + mutant.new.encode() + text[mutant.end :])
            code, out = self.pytest(test, PATIENCE_S + 5.0 * took_s, "-x", *options)
            file.write_bytes(text)
            os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
            for compiled in set(self.cache.glob("hapscene/*")) - self.known:
                compiled.unlink(missing_ok=True)
            if code not in (0, 5):  # 5: nothing to run
                return {"outcome": "killed", "by": [*FAILED.findall(out), test][0] if code is not None else "time"}
        return {"outcome": "survived", "ran": ran}


# --- the run


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument(
        "--package", nargs="*", help="sub-packages or modules, e.g. contact tick plugins (default: all)"
    )
    parser.add_argument("--count", type=int, default=20, help="number of mutants, drawn at random (default: 20)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the draw (default: 0)")
    parser.add_argument("--jobs", type=int, default=2, help="parallel runs (default: 2)")
    parser.add_argument(
        "--budget", type=float, default=60.0, help="time of the tests for each mutant [s] (default: 60)"
    )
    parser.add_argument(
        "--nightly", action="store_true", help="judge by the gate and the nightly tests (default: by the gate)"
    )
    parser.add_argument("--list", action="store_true", help="print the drawn mutants and stop")
    parser.add_argument(
        "--again", type=Path, metavar="JSON", help="results.json of an earlier run: try its survivors instead of a draw"
    )
    parser.add_argument(
        "--out", type=Path, default=ROOT / "out" / "mutants", help="folder of the copies and of results.json"
    )
    given = parser.parse_args()
    files = [file for folder in PACKAGES for file in sorted((ROOT / folder).rglob("*.py"))]
    every = [m for file in files for m in mutants_of(file) if not given.package or m.package in given.package]
    if given.again:
        old = json.loads(given.again.read_text("utf-8"))
        keys = {(e["file"], e["was"], e["now"]) for e in old if e["outcome"] == "survived"}
        drawn = [m for m in every if m.key in keys]
    else:
        drawn = draw(every, given.count, random.Random(given.seed))
    if given.list:
        print("\n".join(f"{m.file}:{m.line}: {m.was}\n    →  {m.now}" for m in drawn))
        return 0
    reasons = tomllib.loads(EQUIVALENT.read_text("utf-8")).get("mutant", [])
    allowed = {(e["file"], e["was"], e["now"]) for e in reasons}
    results = [m._asdict() | {"package": m.package, "outcome": "equivalent"} for m in drawn if m.key in allowed]
    run([m for m in drawn if m.key not in allowed], given, results)
    print(score(results))
    return int(any(r["outcome"] == "survived" for r in results))


def draw(every: list[Mutant], count: int, random: random.Random) -> list[Mutant]:
    """As many of each kind, as far as possible: a plain draw would give numbers most often."""
    heaps = {kind: [m for m in every if m.kind == kind] for kind in sorted({m.kind for m in every})}
    drawn: list[Mutant] = []
    while len(drawn) < min(count, len(every)):
        heap = random.choice([heap for heap in heaps.values() if heap])
        drawn.append(heap.pop(random.randrange(len(heap))))
    return drawn


def run(drawn: list[Mutant], given: argparse.Namespace, results: list[dict[str, Any]]) -> None:
    """Try all; each result is written at once, so that Ctrl-C loses nothing."""
    waiting, before, stop = drawn[::-1], len(results), threading.Event()
    workers = [
        Worker(given.out.resolve() / f"worker-{i}", stop, given.nightly) for i in range(min(given.jobs, len(drawn)))
    ]
    begun = time.monotonic()

    def work(worker: Worker) -> None:
        while waiting and not stop.is_set():
            mutant = waiting.pop()
            found = worker.attempt(mutant, given.budget, given.nightly)
            if stop.is_set():
                return  # stopped: no result
            results.append(mutant._asdict() | {"package": mutant.package} | found)
            done = len(results) - before
            left_min = (time.monotonic() - begun) / done * (len(drawn) - done) / 60
            print(f"{done}/{len(drawn)}, {left_min:.0f} min left: {found['outcome']} {mutant.file}:{mutant.line}")
            print(f"    by {found['by']}" if "by" in found else f"  - {mutant.was}\n  + {mutant.now}", flush=True)
            (given.out / "results.json").write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n", "utf-8")

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    threads = [threading.Thread(target=work, args=(worker,)) for worker in workers]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        try:
            time.sleep(0.2)
        except KeyboardInterrupt:
            stop.set()
        for worker in workers if stop.is_set() else ():
            worker.kill()


def score(results: list[dict[str, Any]]) -> str:
    lines = [f"{'package':16}{'killed':>8}{'of':>5}{'score':>8}{'equivalent':>12}"]
    for package in [*sorted({r["package"] for r in results}), "all"]:
        found = Counter(r["outcome"] for r in results if package in ("all", r["package"]))
        count = found["killed"] + found["survived"]
        share = f"{found['killed'] / count:.0%}" if count else "–"
        lines.append(f"{package:16}{found['killed']:8}{count:5}{share:>8}{found['equivalent']:12}")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
