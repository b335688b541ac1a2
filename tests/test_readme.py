"""The front page and the pages behind it are true: scripts run, tables are the code's."""

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from PIL import Image

import fdjax
from fdjax.app import config
from fdjax.app.cli import main
from fdjax.formats import read_file
from fdjax.machine.protocols import PROTOCOLS

ROOT = Path(__file__).parent.parent
PAGES = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for folder in ("fdjax", "examples")
    for path in [ROOT / "README.md", *(ROOT / folder).rglob("*.md")]
}
README = PAGES["README.md"]
PLATE = ROOT / "examples" / "plate.py"
SET_UP, TESTS = re.findall(r"^.*\.venv/bin/pip install.*$", README, re.MULTILINE)
EACH_PAGE = pytest.mark.parametrize("page", PAGES)


def between(mark: str, page: str = "README.md") -> str:
    """What stands between two comments `<!-- mark -->` and `<!-- /mark -->` on a page."""
    (text,) = re.findall(rf"<!-- {mark} -->\n(.*)<!-- /{mark} -->", PAGES[page], re.DOTALL)
    return text


def anchors_of(page: str) -> set[str]:
    headings = re.findall(r"^##* (.*)$", PAGES[page], re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-") for heading in headings}


def links_of(page: str) -> list[tuple[str, str]]:
    """Where links of a page lead: paths from the root, and the anchor there or ""."""
    found = []
    for link in re.findall(r"\]\(([^)\s]+)\)", PAGES[page]):
        if not link.startswith("http"):
            path, _, anchor = link.partition("#")
            home = (ROOT / page).parent / path if path else ROOT / page
            found.append((home.resolve().relative_to(ROOT.resolve()).as_posix(), anchor))
    return found


def commands() -> list[str]:
    """The commands that any page names, in text and in blocks of the shell's."""
    text = "\n".join(PAGES.values())
    blocks = "\n".join(re.findall(r"```sh\n(.*?)```", text, re.DOTALL))
    return sorted({*re.findall(r"`fdjax (\w+)", text), *re.findall(r"\bfdjax (\w+)", blocks)})


def test_the_front_page_is_short_and_has_a_small_picture():
    assert len(README.encode()) < 12_000
    (picture,) = re.findall(r"!\[.+\]\((.+)\)", README)
    assert (ROOT / picture).stat().st_size < 150_000
    with Image.open(ROOT / picture) as image:
        assert image.size[0] >= 1000


@EACH_PAGE
def test_links_lead_somewhere(page):
    for path, anchor in links_of(page):
        assert (ROOT / path).exists(), path
        assert not anchor or anchor in anchors_of(path), f"{path}#{anchor}"


def test_every_page_is_found_from_the_front_page():
    found, new = set(), {"README.md"}
    while new:
        found |= new
        new = {path for page in new for path, _ in links_of(page) if path in PAGES} - found
    assert found == set(PAGES)


def test_the_job_on_the_front_page_can_be_read():
    (text,) = re.findall(r"```toml\n(.*?)```", README, re.DOTALL)
    assert config.parse(tomllib.loads(text)).kind == "isolines"


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
    assert between("job table", "fdjax/app/README.md") == config.table() + "\n"


def test_protocols_promise_what_the_code_says():
    rows = [f"| {name} | {kind.guarantee} |\n" for name, kind in PROTOCOLS.items()]
    assert between(
        "protocols", "fdjax/machine/README.md"
    ) == "| firmware | promise |\n|---|---|\n" + "".join(rows)


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


@EACH_PAGE
def test_files_that_it_names_are_there(page):
    text = re.sub(r"\]\([^)]*\)", "]", PAGES[page]).replace("\\_", "_")
    named = re.findall(r"(?<![/\w])(?:examples|fdjax|tests|\.ci)/[\w./-]*", text)
    assert [name for name in named if not (ROOT / name.rstrip(".")).exists()] == []


def test_examples_are_all_named():
    files = (ROOT / "examples").iterdir()
    examples = {f"examples/{path.name}" for path in files if path.suffix in (".toml", ".py")}
    assert examples <= set(re.findall(r"\]\((examples/[\w.]+)\)", README))


@pytest.mark.parametrize("command", commands())
def test_commands_that_it_names_are_there(command, capsys):
    assert main([command, "--help"]) == 0
    assert command in capsys.readouterr().out


@pytest.mark.parametrize(
    "page", ["README.md", *(f"fdjax/{room}/README.md" for room in ("app", "formats", "machine"))]
)
def test_options_that_it_names_are_there(page, capsys):
    for command in ("design", "measure", "send", "virtual", "machines"):
        main([command, "--help"])
    text = capsys.readouterr().out
    for option in set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", PAGES[page])):
        assert option in text


def rooms_in_order() -> list[str]:
    """As the page on the layout lists them."""
    return re.findall(r"`fdjax/(\w+)(?:/|\.py)`", PAGES["fdjax/README.md"])


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
            assert other == room or other in above, f"{path}: {module}"
            if room == "machine":
                assert other in ("errors", "units", "formats", *following, room)
            if room in ("plan", "formats", "view"):
                light = other in (
                    "errors",
                    "units",
                    "limits",
                    "beside",
                    "part",
                    "plan",
                    *following,
                    room,
                )
                assert light or module in WITHOUT_JAX, f"{path}: {module}"


WITHOUT_JAX = ("road.bead", "road.stroke", "target.field")
"""What rooms that load no JAX take from rooms that do."""
