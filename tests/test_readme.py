"""The README is true: its script runs, its table is the code's, what it names is there."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import fdjax
from fdjax.app import config
from fdjax.app.cli import main
from fdjax.formats import read_file
from fdjax.machine.protocols import PROTOCOLS

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
PLATE = ROOT / "examples" / "plate.py"
SET_UP, TESTS = re.findall(r"^.*\.venv/bin/pip install.*$", README, re.MULTILINE)


def between(mark: str) -> str:
    """What stands between two comments `<!-- mark -->` and `<!-- /mark -->`."""
    (text,) = re.findall(rf"<!-- {mark} -->\n(.*)<!-- /{mark} -->", README, re.DOTALL)
    return text


def test_python_block_is_the_example():
    assert between("script") == f"```python\n{PLATE.read_text(encoding='utf-8')}```\n"


def test_example_uses_public_names_only():
    tree = ast.parse(PLATE.read_text(encoding="utf-8"))
    assert not any(isinstance(node, ast.ImportFrom) for node in ast.walk(tree))
    used = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "fdjax"
    }
    assert used <= set(fdjax.__all__)


def test_example_runs(tmp_path):
    run = subprocess.run(
        [sys.executable, PLATE], cwd=tmp_path, capture_output=True, text=True, timeout=600
    )
    assert run.returncode == 0, run.stderr
    (error,) = re.findall(r"RMS porosity error (\S+)\n", run.stdout)
    assert float(error) <= 0.0045
    assert [path.name for path in tmp_path.iterdir()] == ["plate.gcode"]
    assert len(read_file(tmp_path / "plate.gcode").layers) == 10


def test_job_table_is_up_to_date():
    assert between("job table") == config.table() + "\n"


def test_protocols_promise_what_the_code_says():
    rows = [f"| {name} | {kind.guarantee} |\n" for name, kind in PROTOCOLS.items()]
    assert between("protocols") == "| firmware | promise |\n|---|---|\n" + "".join(rows)


def test_set_up_lines_are_what_is_checked():
    checked = (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    install, test = (command.removeprefix(".venv/bin/") for command in TESTS.split(" && "))
    assert install in checked
    assert test in checked
    steps = SET_UP.split(" && ")
    assert steps[0] == "python3.11 -m venv .venv"
    # The same install without the test extra.
    assert steps[1] == ".venv/bin/pip install -e ."
    assert install == "pip install -e '.[test]'"
    assert steps[2] == ".venv/bin/fdjax design examples/graded_plate.toml --out out/"


def test_outputs_are_those_of_the_job():
    job = config.load(ROOT / "examples" / "graded_plate.toml")
    section = README.split("## What lands in `out/`")[1].split("\n## ")[0]
    named = re.findall(r"^\| `([\w.]+)` \|", section, re.MULTILINE)
    assert sorted(named) == sorted(job.outputs)


def test_files_that_it_names_are_there():
    named = re.findall(r"(?<![/\w])(?:examples|fdjax|tests|\.ci)/[\w./-]*", README)
    assert [name for name in named if not (ROOT / name.rstrip(".")).exists()] == []


def test_examples_are_all_named():
    files = (ROOT / "examples").iterdir()
    examples = {f"examples/{path.name}" for path in files if path.suffix in (".toml", ".py")}
    assert examples <= set(re.findall(r"\]\((examples/[\w.]+)\)", README))


@pytest.mark.parametrize("command", sorted(set(re.findall(r"`fdjax (\w+)", README))))
def test_commands_that_it_names_are_there(command, capsys):
    assert main([command, "--help"]) == 0
    assert command in capsys.readouterr().out


def test_options_that_it_names_are_there(capsys):
    for command in ("design", "measure", "send", "virtual", "machines"):
        main([command, "--help"])
    text = capsys.readouterr().out
    section = README.split("## Commands")[1].split("\n## ")[0]
    for option in set(re.findall(r"--[a-z][a-z-]*", section)):
        assert option in text


def test_links_inside_it_lead_somewhere():
    headings = re.findall(r"^## (.*)$", README, re.MULTILINE)
    anchors = {re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-") for heading in headings}
    for anchor in re.findall(r"\]\(#([\w-]+)\)", README):
        assert anchor in anchors


def rooms_in_order() -> list[str]:
    section = README.split("## Layout")[1]
    return re.findall(r"`fdjax/(\w+)(?:/|\.py)`", section)


def imports_of(path: Path) -> set[str]:
    """Modules of fdjax that this one loads, as `room` or `room.module`."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("fdjax."):
            home = node.module.removeprefix("fdjax.")
            found |= {home} if "." in home else {f"{home}.{name.name}" for name in node.names}
    return found


def test_rooms_import_from_rooms_above():
    order = rooms_in_order()
    following = ("arcs", "moves", "gcode")
    folder = ROOT / "fdjax"
    rooms = {path.relative_to(folder).parts[0] for path in folder.rglob("*.py")}
    assert {room.removesuffix(".py") for room in rooms} == {*order, "__init__", "__main__"}
    for path in folder.rglob("*.py"):
        room = path.relative_to(folder).parts[0].removesuffix(".py")
        if room in ("__init__", "__main__"):
            continue
        above = order[: order.index(room)]
        for module in imports_of(path):
            other = module.split(".")[0]
            exception = room in ("pattern", "design") and module == "plan.limits"
            assert other == room or other in above or exception, f"{path}: {module}"
            if room == "machine":
                assert other in ("errors", "units", "formats", *following, room)
            if room in ("plan", "formats", "view"):
                assert (
                    other in ("errors", "units", "plan", *following, room) or module == "road.bead"
                )
