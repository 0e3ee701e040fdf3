"""What a linter cannot know about this house: sizes, doors, purity, and that each of these checks bites."""

import ast
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("sfid_core", "protocol", "services")
FUNCTION_LINES_MAX = 50
FILE_LINES_MAX = 400
GENERATORS = {"default_rng", "SeedSequence", "PCG64", "Philox", "SFC64", "MT19937", "Random"}

# The brackets in a pattern keep it from finding itself.
INDEX_HOST = re.compile(r"py[p]i\.org|python[h]osted|deb[.]debian|registry[.]npmjs|--(extra-)?index-ur[l]\s")
MACHINE_PATH = re.compile(r"(?<![\w.$}])/(home|root|work|Users)/\w|\b[A-Z]:\\Users")
LEFTOVER = re.compile(r"\b(TO[D]O|FIX[M]E|XX[X]|HAC[K])\b")

Function = ast.FunctionDef | ast.AsyncFunctionDef
Rule = Callable[[Path, ast.Module], Iterator[str]]


# --- the rules: each takes a file of the packages and yields what is wrong with it ---


def name_of(node: ast.expr) -> str:
    """The last part of a dotted name, empty when the node is none."""
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def body_without_docstring(node: Function) -> list[ast.stmt]:
    return node.body[1:] if ast.get_docstring(node) is not None else node.body


def functions_too_long(_: Path, tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, Function):
            lines = (node.end_lineno or node.lineno) - node.lineno + 1
            if ast.get_docstring(node) is not None:
                lines -= (node.body[0].end_lineno or 0) - node.body[0].lineno + 1
            if lines > FUNCTION_LINES_MAX:
                yield f"{node.lineno}: {node.name} has {lines} lines, {FUNCTION_LINES_MAX} are allowed"


def environment_read_outside_configuration(path: Path, tree: ast.Module) -> Iterator[str]:
    if "config" in path.name:
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            read = ast.unparse(node) in {"os.environ", "os.getenv", "os.putenv"}
        elif isinstance(node, ast.ImportFrom) and node.module == "os":
            read = any(alias.name in {"environ", "getenv"} for alias in node.names)
        else:
            continue
        if read:
            yield f"{node.lineno}: settings are read from the environment in a config module only"


def generator_without_a_seed(_: Path, tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Call)
            and name_of(node.func) in GENERATORS
            and not (node.args or node.keywords)
        ):
            yield f"{node.lineno}: {name_of(node.func)}() without a seed cannot be replayed"


def docstrings_of(tree: ast.Module) -> set[ast.Constant]:
    return {
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }


def key_written_by_hand(path: Path, tree: ast.Module) -> Iterator[str]:
    if path.parts[-2:] == ("protocol", "keys.py"):
        return
    prose = docstrings_of(tree)
    for node in ast.walk(tree):
        if not isinstance(node, ast.Constant) or not isinstance(node.value, str) or node in prose:
            continue
        if re.search(r"(^|[\s@])sfid/", node.value):
            yield f"{node.lineno}: keys on the wire are built in protocol/keys.py"


def no_module_docstring(_: Path, tree: ast.Module) -> Iterator[str]:
    if not ast.get_docstring(tree):
        yield "1: a module says first what it is for"


def unfinished_function(_: Path, tree: ast.Module) -> Iterator[str]:
    protocols = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef) if is_interface(node)]
    excused = {id(inner) for node in protocols for inner in node.body}
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) and node.exc is not None and "NotImplemented" in ast.unparse(node.exc):
            yield f"{node.lineno}: not implemented"
        if not isinstance(node, Function) or id(node) in excused or is_overload(node):
            continue
        if [ast.unparse(statement) for statement in body_without_docstring(node)] == ["..."]:
            yield f"{node.lineno}: {node.name} is a stub"


def is_interface(node: ast.ClassDef) -> bool:
    return any(
        name_of(base.value if isinstance(base, ast.Subscript) else base) == "Protocol" for base in node.bases
    )


def is_overload(node: Function) -> bool:
    return any(name_of(decorator) in {"overload", "abstractmethod"} for decorator in node.decorator_list)


def file_too_long(path: Path, tree: ast.Module) -> Iterator[str]:
    lines = max((getattr(node, "end_lineno", 0) for node in tree.body), default=0)
    if lines > FILE_LINES_MAX:
        yield f"{lines}: {path.name} has {lines} lines, {FILE_LINES_MAX} are allowed"


def sleep_in_a_test(_: Path, tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and name_of(node.func) == "sleep":
            yield f"{node.lineno}: a test waits for the event, with a deadline; it does not sleep"


def patch_in_a_test(_: Path, tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            patches = node.module in {"unittest", "unittest.mock", "mock"}
        elif isinstance(node, ast.Attribute):
            patches = ast.unparse(node) == "monkeypatch.setattr"
        else:
            continue
        if patches:
            yield f"{node.lineno}: a test uses the fake an interface ships with; it does not patch"


RULES: list[Rule] = [
    functions_too_long,
    environment_read_outside_configuration,
    generator_without_a_seed,
    key_written_by_hand,
    no_module_docstring,
    unfinished_function,
    file_too_long,
]
RULES_OF_TESTS: list[Rule] = [sleep_in_a_test, patch_in_a_test, generator_without_a_seed]

PLANTED: dict[Rule, str] = {
    functions_too_long: "def f() -> int:\n" + "    x = 1\n" * FUNCTION_LINES_MAX + "    return x\n",
    environment_read_outside_configuration: "import os\nHOME = os.environ['HOME']\n",
    generator_without_a_seed: "import numpy as np\nrng = np.random.default_rng()\n",
    key_written_by_hand: "def key(session: str) -> str:\n    return f'sfid/{session}/state'\n",
    no_module_docstring: "x = 1\n",
    unfinished_function: "def f() -> int:\n    '''Later.'''\n    ...\n",
    file_too_long: "x = 1\n" * (FILE_LINES_MAX + 1),
    sleep_in_a_test: "import time\ntime.sleep(1)\n",
    patch_in_a_test: "from unittest.mock import patch\n",
}


def places(paths: list[Path], rule: Rule) -> list[str]:
    """Where files break a rule, as `path:line: what is wrong`."""
    return [
        f"{path.relative_to(ROOT)}:{place}"
        for path in paths
        for place in rule(path, ast.parse(path.read_text(encoding="utf-8")))
    ]


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.__name__)
def test_no_file_of_the_packages_breaks_the_rule(rule: Rule) -> None:
    paths = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    assert paths
    assert places(paths, rule) == []


@pytest.mark.parametrize("rule", RULES_OF_TESTS, ids=lambda rule: rule.__name__)
def test_no_test_breaks_the_rule(rule: Rule) -> None:
    paths = sorted((ROOT / "tests").rglob("*.py"))
    assert places(paths, rule) == []


@pytest.mark.parametrize("rule", PLANTED, ids=lambda rule: rule.__name__)
def test_the_rule_finds_a_planted_fault(rule: Rule) -> None:
    found = list(rule(Path("services/planted.py"), ast.parse(PLANTED[rule])))
    assert len(found) == 1
    assert re.match(r"\d+: ", found[0])


def test_no_two_test_files_share_a_name() -> None:
    names = [path.name for path in (ROOT / "tests").rglob("test_*.py")]
    assert sorted(names) == sorted(set(names))


# --- the text of all files ---


def files_of_the_project() -> list[Path]:
    """Files git keeps, or would keep: those it does not ignore."""
    command = ["git", "-c", "safe.directory=*", "ls-files", "-co", "--exclude-standard"]
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout: which files belong to the project is not known")
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return [ROOT / name for name in listed.stdout.splitlines() if (ROOT / name).is_file()]


@pytest.mark.parametrize(
    "pattern,planted",
    [
        (INDEX_HOST, "--index-url" + " https://example.invalid/simple"),
        (MACHINE_PATH, "cd /" + "home/somebody/sfid"),
        (LEFTOVER, "# TO" + "DO later"),
    ],
    ids=["no package index", "no path of one machine", "nothing left for later"],
)
def test_no_file_of_the_project_contains_the_pattern(pattern: re.Pattern[str], planted: str) -> None:
    assert pattern.search(planted)
    found = []
    for path in files_of_the_project():
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue  # golden bytes and pictures
        found += [
            f"{path.relative_to(ROOT)}:{number}: {line.strip()[:80]}"
            for number, line in enumerate(text.splitlines(), 1)
            if pattern.search(line)
        ]
    assert found == []


# --- who may import whom: the contracts of pyproject.toml ---


def lint_imports(directory: Path) -> subprocess.CompletedProcess[str]:
    """Check the packages below a directory by the contracts of this project."""
    command: list[str | Path] = [
        Path(sys.executable).with_name("lint-imports"),
        "--no-cache",
        "--config",
        ROOT / "pyproject.toml",
    ]
    return subprocess.run(command, cwd=directory, capture_output=True, text=True, check=False, timeout=60)


def test_every_import_contract_holds() -> None:
    outcome = lint_imports(ROOT)
    assert outcome.returncode == 0, outcome.stdout + outcome.stderr
    assert " 0 broken." in outcome.stdout


@pytest.mark.parametrize(
    "path,statement,contract",
    [
        ("protocol/journal.py", "import services.runtime", "Imports run one way"),
        ("sfid_core/session/machine.py", "import protocol.codec", "Imports run one way"),
        ("sfid_core/mdp.py", "import time", "The core has no clock"),
        ("sfid_core/learning/sfid.py", "from random import random", "The core has no clock"),
        ("protocol/identity.py", "import socket", "The wire is pure"),
        ("services/router.py", "import zenoh", "Only services.runtime.zenoh_bus imports zenoh"),
        ("services/exports/recording.py", "import rerun as rr", "Only services.monitor imports rerun"),
        ("services/runtime/journal_file.py", "import msgpack", "Only protocol.codec imports msgpack"),
        ("services/environment.py", "import services.learner", "Services meet on the wire"),
        ("services/teachers/keyboard.py", "import services.monitor.live", "Services meet on the wire"),
        ("services/runtime/loop.py", "import services.learner", "Services meet on the wire"),
        ("services/client.py", "import services.supervisor", "Services meet on the wire"),
        ("services/a_new_one.py", "", "Services meet on the wire"),
        ("services/cli/shared/options.py", "import services.cli.status", "What commands share"),
        ("services/cli/status.py", "import services.cli.main", "What commands share"),
        ("services/cli/a_new_one.py", "", "What commands share"),
    ],
)
def test_a_planted_import_breaks_its_contract(
    path: str, statement: str, contract: str, tmp_path: Path
) -> None:
    for package in (*PACKAGES, "services/cli"):
        plant(tmp_path / package / "__init__.py", "")
    for name in re.findall(r"(?:services|protocol)[.\w]*", statement):
        plant(tmp_path / (name.replace(".", "/") + ".py"), "")
    plant(tmp_path / path, statement)

    outcome = lint_imports(tmp_path)

    broken = [line for line in outcome.stdout.splitlines() if line.endswith(" BROKEN")]
    assert outcome.returncode == 1, outcome.stdout + outcome.stderr
    assert [line for line in broken if line.startswith(contract)], outcome.stdout


def plant(path: Path, text: str) -> None:
    """Write a module, and make packages of the directories above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    (path.parent / "__init__.py").touch()
    path.write_text(text, encoding="utf-8")


def test_the_doors_are_open_to_those_who_may_use_them(tmp_path: Path) -> None:
    doors = {
        "services/runtime/zenoh_bus.py": "import zenoh",
        "services/monitor/pictures.py": "import rerun.blueprint as rrb",
        "protocol/codec.py": "import msgpack\nimport msgspec",
        "sfid_core/mdp.py": "import numpy as np",
    }
    for package in (*PACKAGES, "services/cli"):
        plant(tmp_path / package / "__init__.py", "")
    for path, statement in doors.items():
        plant(tmp_path / path, statement)
    outcome = lint_imports(tmp_path)
    assert outcome.returncode == 0, outcome.stdout + outcome.stderr
