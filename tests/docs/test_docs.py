"""The docs are true: their code runs, what it prints is what they say, links and names exist."""

import ast
import importlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tomllib
import venv
from fnmatch import fnmatch
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest
from scripts import script

import slipctl
from slipctl.study import case_setup, execution
from slipctl.study.files import results_folder
from slipctl.study.resolve import load_study

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
RUNNER = ROOT / "tests" / "pages.py"
PAGES = (
    "workbench.md",
    "concepts.md", "architecture.md", "certify.md", "contact.md", "nmpc.md", "c_interface.md",
    "fmu.md", "all_rails.md", "laws.md", "sweeps.md", "tune.md", "replay.md", "own_vehicle.md",
    "own_law.md", "own_controller.md", "own_slide_protection.md", "start.md",
    "python_control.md", "own_figures.md",
    "notebook.md", "gallery.md", "predictive.md", "leaf_fall.md", "theory.md",
    "trials.md", "own_proof.md",
)  # fmt: skip
"""Pages whose code is run, beside the tutorial."""

HAND_WRITTEN = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted(DOCS.glob("*.md"))]


def run_page(page: Path, folder: Path, python: str = sys.executable) -> None:
    """Run the code of a page in an empty folder; ``slipctl`` is the one beside ``python``."""
    folder.mkdir()
    environment = os.environ | {"PATH": f"{Path(python).parent}{os.pathsep}{os.environ['PATH']}"}
    environment.pop("PYTHONPATH", None)
    done = subprocess.run(
        [python, str(RUNNER), str(page)], cwd=folder, env=environment, capture_output=True,
        text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


LONG = (
    "gallery.md", "predictive.md",
    "all_rails.md", "certify.md", "laws.md", "leaf_fall.md", "nmpc.md", "own_controller.md",
    "own_figures.md", "own_proof.md", "own_slide_protection.md", "replay.md", "start.md",
    "sweeps.md", "theory.md", "trials.md", "tune.md",
)  # fmt: skip
"""Pages of pictures alone, which the build of the site draws, and whose code takes 5 s and more."""


@pytest.mark.second
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.long) if n in LONG else n for n in PAGES]
)
@pytest.mark.others("long")
def test_code_of_the_page_runs(name, tmp_path):
    run_page(DOCS / name, tmp_path / "empty")


@pytest.mark.second
def test_python_of_the_readme_runs(tmp_path):
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    code = re.findall(r"^```python\n(.*?)^```$", text, flags=re.M | re.S)
    assert code
    for body in code:  # what a line says it gives is what it gives
        tree, lines = ast.parse(body), body.splitlines()
        shown = [ast.get_source_segment(body, n) for n in tree.body if isinstance(n, ast.Expr)]
        names: dict = {}
        exec(body, names)
        for expression in shown:
            line = next(k for k in lines if k.startswith(expression.splitlines()[0]))
            _, _, said = line.partition("#")
            found = re.match(r"\s*([{\[].*?[}\]])(?= : |$)", said)
            if found:
                value = repr(eval(expression, names))
                pattern = re.escape(found[1]).replace(re.escape("..."), r"\d+")
                assert re.fullmatch(pattern, value), f"{expression} gives {value}, not {found[1]}"


def wheel_of(folder: Path) -> Path | None:
    """Build a wheel from a copy of the clone; None without a network to fetch setuptools from."""
    copy = folder / "clone"
    skip = shutil.ignore_patterns(".git", ".venv", "out", "build", "dist", "__pycache__",
                                  "*.egg-info", ".*_cache")  # fmt: skip
    shutil.copytree(ROOT, copy, ignore=skip)
    command = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "-q",
        "--no-deps",
        "-w",
        str(folder),
        str(copy),
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode and re.search(
        r"[Cc]onnection|[Tt]emporary failure|No matching", done.stderr
    ):
        return None
    assert done.returncode == 0, done.stderr
    return next(folder.glob("*.whl"))


@pytest.mark.long
def test_tutorial_runs(tmp_path, needs_compiler):
    """From a wheel in a fresh environment, which sees the libraries installed here."""
    wheel = wheel_of(tmp_path)
    if wheel is None:  # then from the clone
        run_page(DOCS / "tutorial.md", tmp_path / "empty")
        return
    home = tmp_path / "venv"
    venv.create(home, with_pip=False)
    python = str(home / ("Scripts" if os.name == "nt" else "bin") / "python")
    install = [sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-deps",
               str(wheel)]  # fmt: skip
    done = subprocess.run(install, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    ask = "import sysconfig; print(sysconfig.get_path('purelib'))"
    packages = subprocess.run([python, "-c", ask], capture_output=True, text=True).stdout.strip()
    libraries = [p for p in sys.path if p.endswith("-packages")]
    Path(packages, "libraries.pth").write_text("\n".join(libraries))
    ask = "import slipctl.models; print(slipctl.__file__, *slipctl.models.__path__)"
    found = subprocess.run([python, "-c", ask], cwd=tmp_path, capture_output=True, text=True)
    assert all(p.startswith(str(home)) for p in found.stdout.split()), found
    run_page(DOCS / "tutorial.md", tmp_path / "empty", python)


# ---- the reference and the floors ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("tool", "page", "made"),
    [
        pytest.param("make_api", "api.md", "page", marks=pytest.mark.second),
        ("make_claims", "claims.md", "page"), ("make_controllers", "c_controllers.md", "page"),
        ("make_failures", "failures.md", "page"), ("make_reference", "commands.md", "commands"),
        ("make_reference", "metrics.md", "metrics"),
        ("make_reference", "file_keys.md", "file_keys"),
        ("make_wrong_samples", "c_interface.md", "page"),
    ],
)  # fmt: skip
def test_a_page_that_is_made_is_fresh(tool, page, made):
    """From the code, the studies or the evidence that it tells of."""
    text = (DOCS / page).read_text(encoding="utf-8")
    assert getattr(script(tool), made)() == text, f"run: python docs/tools/{tool}.py"


def test_rows_of_wrong_samples_count_what_was_slow():
    fault = dict(own=0.2, alike=None, allowed=0.1, missed=0, locks=False, ticks=10, told=10)
    found = {"faults": 9, "slow": [fault, fault | {"own": 0.1}, fault | {"alike": 0.05}]}
    rows = script("make_wrong_samples").rows({"a:b": found})
    assert rows == "| `a:b` | 9 | 6 | 2 | 0 | 1 | 0 | 1 |\n"


# ---- rooms ---------------------------------------------------------------------------------------


def rooms() -> ModuleType:
    """Floors as docs/architecture.md says, imports as the code has them."""
    return script("make_rooms")


def test_each_room_has_a_floor():
    engine = {p.name for p in (ROOT / "slipctl").iterdir() if (p / "__init__.py").exists()}
    assert set(rooms().floors()) == engine | {"errors", "registry", "models", "studies"}
    files = {p.name for p in (ROOT / "slipctl").glob("*.py")}
    assert files == {"__init__.py", "__main__.py", "errors.py", "old_names.py", "registry.py"}


@pytest.mark.second
def test_each_room_imports_only_from_lower_floors():
    floor = rooms().floors()
    upwards = {pair for pair in rooms().imports() if floor[pair[0]] <= floor[pair[1]]}
    assert not upwards


@pytest.mark.second
def test_nothing_that_is_installed_needs_the_benches():
    """Nor does a benchmark need a package's line: `bench` is in the clone alone."""
    files = [
        p for folder in ("slipctl", "models", "studies") for p in (ROOT / folder).rglob("*.py")
    ]
    assert len(files) > 300
    found = {n.partition(".")[0]: path for path in files for n in rooms().named(path)}
    assert "bench" not in found, found.get("bench")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert not [p for p in project["tool"]["setuptools"]["packages"] if "bench" in p.split(".")]


@pytest.mark.second
def test_no_modules_import_each_other_in_a_circle():
    """Imports inside functions count; those for types alone do not."""
    assert rooms().circles() == []


def test_each_room_says_its_question_and_nothing_else():
    for path in (ROOT / "slipctl").rglob("*/__init__.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        assert len(tree.body) == 1, f"{path}: a room holds no code"
        assert "?" in (ast.get_docstring(tree) or ""), f"{path}: ask what belongs here"


@pytest.mark.second
def test_picture_of_the_rooms_is_that_of_the_imports():
    picture = rooms().picture(rooms().table(), rooms().imports())
    fresh = rooms().PICTURE.read_text(encoding="utf-8") == picture
    assert fresh, "run: python docs/tools/make_rooms.py"


LONG = re.compile(r"^\| `([\w/.]+\.py)` \| (\d+) \|", re.M)


def test_no_module_is_long_unless_the_page_says_why():
    """At most 500 lines; docs/architecture.md lists what is longer, with its reason."""
    told = dict(LONG.findall((DOCS / "architecture.md").read_text(encoding="utf-8")))
    found = {}
    for folder in ("slipctl", "models", "studies", "bench"):
        for path in (ROOT / folder).rglob("*.py"):
            lines = len(path.read_text(encoding="utf-8").splitlines())
            if lines > 500:
                found[str(path.relative_to(ROOT).as_posix())] = lines
    assert set(found) == set(told)
    assert all(lines <= int(told[name]) for name, lines in found.items())


def test_public_names_stay_where_they_are():
    """What a user imports does not move with the rooms."""
    import slipctl.models
    from slipctl.study import resolve

    for name in slipctl.__all__:
        assert getattr(slipctl, name) is not None
    bounds = ("super_twisting", "reaching_law", "prescribed_performance", "barrier", "extremum",
              "filters", "observers", "steps", "higher_order", "adhesion_observer")  # fmt: skip
    for name in bounds:
        assert importlib.util.find_spec(f"slipctl.certify.{name}")
    stems = ("subway_braking", "hst_braking", "hst_traction", "freight_traction", "all_rails",
             "gain_bounds", "predictive", "leaf_fall")  # fmt: skip
    assert set(stems) <= set(resolve.studies())
    for stem in stems:
        module = importlib.import_module(f"slipctl.studies.{stem}")
        assert isinstance(module.study, slipctl.Study)
        if stem not in ("all_rails", "gain_bounds", "predictive", "leaf_fall"):
            assert importlib.util.find_spec(f"slipctl.models.{stem}")
    for bench in ("speed", "c_targets", "endurance", "fmus"):
        assert importlib.import_module(f"bench.{bench}").main


def test_help_loads_nothing_heavy():
    code = "import slipctl.commands.cli, sys; slipctl.commands.cli.parser(); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert not {"casadi", "numpy", "scipy", "matplotlib", "xarray", "pint"} & set(
        done.stdout.split()
    )


# ---- the study's page ----------------------------------------------------------------------------


def tables(text: str) -> list[tuple[str, str]]:
    """What each table of a page is, and its text."""
    return re.findall(r"<!-- table (.+?) -->\n(.*?)<!-- end -->", text, flags=re.S)


def cells(table: str) -> list[str]:
    return [c.strip() for row in table.strip().splitlines() for c in row.strip("|").split("|")]


def close(a: str, b: str) -> bool:
    """Equal, or numbers that agree to 5 %: chattering differs with the mathematics library."""
    pairs = list(zip(a.split(" / "), b.split(" / "), strict=False))
    return a == b or all(
        x == y or float(x) == pytest.approx(float(y), rel=0.05, abs=5e-3) for x, y in pairs
    )


@pytest.fixture(scope="module")
def results(tmp_path_factory) -> Path:
    """Metrics of the study's scenarios, without its experiments."""
    folder = tmp_path_factory.mktemp("results")
    study = load_study("subway_braking")
    cases, chosen = case_setup.prepare(study)
    found = execution.run(study, cases, chosen, experiments=False)
    results_folder.save_metrics(found, folder, "pytest")
    return folder


@pytest.mark.long
def test_tables_of_metrics_are_what_the_study_gives(results):
    maker = script("make_tables")
    page = (DOCS / "subway_braking.md").read_text(encoding="utf-8")
    new = maker.filled(page, results, ("metrics",))
    before, after = tables(page), tables(new)
    assert [k for k, _ in before] == [k for k, _ in after]
    for (kind, old), (_, fresh) in zip(before, after, strict=True):
        assert len(cells(old)) == len(cells(fresh)), f"{kind}: run docs/tools/make_tables.py"
        for a, b in zip(cells(old), cells(fresh), strict=True):
            assert close(a, b), f"{kind}: {a} is {b} now; run docs/tools/make_tables.py"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [(["--chek"], "unrecognized arguments: --chek"), (["nope"], "nope has no page"),
     (["all_rails", "--results", "/nowhere"], "cannot read /nowhere")],
)  # fmt: skip
def test_tables_refuse_what_they_do_not_know_in_a_line(arguments, said, capsys):
    maker = script("make_tables")
    with pytest.raises(SystemExit) as ended:
        maker.main(arguments)
    told = capsys.readouterr().err
    assert ended.value.code == 2
    assert said in told
    assert told.count("\n") == 1


@pytest.mark.parametrize("name", ["subway_braking", "freight_traction", "hst_traction"])
def test_page_of_the_study_has_every_claim_and_scenario(name):
    page = (DOCS / f"{name}.md").read_text(encoding="utf-8")
    study = load_study(name)
    for claim in study.claims:
        assert claim.claim in page, f"{claim.id}: run docs/tools/make_tables.py"
    named = set(re.findall(r"`(\w+)`", page))
    for case in study.cases(study.models, False):
        assert {case.scenario.name, *case.loops} <= named


# ---- text ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("page", HAND_WRITTEN, ids=lambda p: p.name)
def test_links_lead_somewhere(page):
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


@cache
def names_of_tests() -> set[str]:
    """Functions of all test files, methods too."""
    files = (ROOT / "tests").rglob("test_*.py")
    return {n for p in files for n in re.findall(r"^ *def (\w+)", p.read_text("utf-8"), re.M)}


@pytest.mark.parametrize("page", HAND_WRITTEN, ids=lambda p: p.name)
def test_names_of_files_and_tests_exist(page):
    text = page.read_text(encoding="utf-8")
    for name in re.findall(r"`(test_\w+)`", text):
        assert name in names_of_tests(), f"{page.name}: {name}"
    # but those it writes
    file = r"`((?:slipctl|models|studies|bench|tests|docs)/[\w/]+\.\w+)`(?!:\n\n```)"
    for name in re.findall(file, text):
        assert (ROOT / name).exists(), f"{page.name}: {name}"


def test_errata_are_all_tested_or_explained():
    """Each row of the errata names a test, or is about words and letters only."""
    text = (DOCS / "errata.md").read_text(encoding="utf-8")
    pieces = re.split(r"^### (\d{3}\.\d+) ", text, flags=re.M)
    untested = {n for n, row in zip(pieces[1::2], pieces[2::2], strict=True) if "test_" not in row}
    words_only = {
        "000.4",
        "000.5",
        "000.7",
        "000.14",
        "000.18",
        "000.24",
        "000.30",
        "000.31",
        "000.32",
        "001.4",
        "001.7",
        "001.11",
        "001.19",
        "001.22",
        "001.31",
        "003.19",
        "003.20",
        "003.21",
        "004.12",
        "004.24",
        "004.28",
        "004.29",
        "004.31",
        "004.32",
        "004.33",
    }
    assert untested == words_only


def test_public_names_are_in_the_reference():
    text = (DOCS / "api.md").read_text(encoding="utf-8")
    for name in slipctl._HOME:
        assert re.search(rf"^### {name}$", text, flags=re.M), name


def test_every_package_is_listed():
    """Packages are listed by hand: one that is not is in the clone and missing in the wheel."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    found = {
        ".".join((package, *file.parent.relative_to(ROOT / folder).parts))
        for folder, package in (("slipctl", "slipctl"), ("models", "slipctl.models"),
                                ("studies", "slipctl.studies"))
        for file in (ROOT / folder).rglob("__init__.py")
    }  # fmt: skip
    assert found == set(project["tool"]["setuptools"]["packages"])


def test_every_file_that_is_no_python_is_packaged():
    """What a module reads beside itself has to reach whoever installs a wheel."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    tool = project["tool"]["setuptools"]
    data = {p.replace(".", "/"): patterns for p, patterns in tool["package-data"].items()}
    for folder in ("slipctl", "models", "studies"):
        for file in (ROOT / folder).rglob("*"):
            if not file.is_file() or file.suffix in (".py", ".pyc"):
                continue
            inside = file.relative_to(ROOT).as_posix()
            inside = inside if folder == "slipctl" else f"slipctl/{inside}"
            assert any(
                fnmatch(inside, f"{package}/{pattern}")
                for package, patterns in data.items()
                for pattern in patterns
            ), f"{inside} is in no package-data of pyproject.toml"
