"""A sender starts at once, and imports go one way."""

import ast
import subprocess
import sys
from pathlib import Path

import fdjax

HOME = Path(fdjax.__file__).parent


def test_a_stream_is_there_at_once_and_without_arrays():
    script = (
        "import sys, time; began = time.process_time(); import fdjax.machine.stream; "
        "took = time.process_time() - began; from fdjax.gcode.state import GcodeState; "
        "GcodeState().run('G2 X10 R5 E1'); "
        "assert not {'numpy', 'shapely', 'jax'} & sys.modules.keys(); print(took)"
    )
    run = [sys.executable, "-c", script]
    times = [
        float(subprocess.run(run, capture_output=True, text=True, check=True).stdout)
        for _ in range(3)
    ]
    assert min(times) < 0.3


def imported(path: Path) -> set[str]:
    """Modules of fdjax that a file imports, wherever in it, but not for types alone."""
    names = set()
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            node.body = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("fdjax"):
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return names


def test_imports_go_one_way():
    files = {}
    for path in HOME.rglob("*.py"):
        parts = ("fdjax", *path.relative_to(HOME).with_suffix("").parts)
        files[".".join(parts).removesuffix(".__init__")] = path
    wants = {name: imported(path) & (files.keys() - {name}) for name, path in files.items()}
    own = {name for name in files if name.startswith(("fdjax.machine", "fdjax.gcode"))}
    for name in own:
        seen, open_ = set(), [name]
        while open_:
            for other in wants[open_.pop()] - seen:
                seen.add(other)
                open_.append(other)
        assert name not in seen, name
    for name, others in wants.items():
        if name.startswith(("fdjax.gcode", "fdjax.formats")):
            assert not any(other.startswith("fdjax.machine") for other in others), name
