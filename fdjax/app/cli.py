"""The command line. Nothing heavy is imported before a command runs: `--help` answers at once."""

import argparse
import gc
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from fdjax.errors import DesignError, InputError, StreamError

if TYPE_CHECKING:
    from fdjax.app.measuring import Answer

BAD_INPUT, FAILED_DESIGN, STOPPED, INTERRUPTED = 2, 3, 4, 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code.

    0: done. 2: something given cannot be used (one line on stderr says what). 3: a design folds,
    does not converge, misses its tolerance or breaks a machine limit. 4: a print that had begun
    stopped. 130: interrupted.
    """
    try:
        arguments = _parser().parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    try:
        arguments.command(arguments)
        sys.stdout.flush()
    except InputError as fault:
        return _fail(fault, BAD_INPUT)
    except DesignError as fault:
        return _fail(fault, FAILED_DESIGN)
    except StreamError as fault:
        return _fail(fault, STOPPED)
    except KeyboardInterrupt:
        return _fail("interrupted", INTERRUPTED)
    except BrokenPipeError:
        # Whoever reads the output has had enough: what is left of it goes nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def command() -> NoReturn:
    """`main` as a program, which ends at once: what it holds need not be taken apart first."""
    code = main()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _fail(fault: object, code: int) -> int:
    print(f"fdjax: error: {fault}", file=sys.stderr)
    return code


def _design(arguments: argparse.Namespace) -> None:
    _prepare_jax()
    from fdjax.app import config
    from fdjax.app.output import output_folder

    job = config.load(arguments.job)
    if arguments.force_export:
        job = replace(job, design=replace(job.design, export_failed=True))
    with (
        output_folder(arguments.out, owned=job.outputs) as folder,
        _Progress(arguments) as progress,
    ):
        from fdjax.app import run

        summary = run.design(job, folder, progress=progress)
    if not arguments.quiet:
        print(summary)


def _measure(arguments: argparse.Namespace) -> None:
    from fdjax.beside import Beside

    with Beside("fdjax.view.figures") as beside:
        answer = _measured(arguments)
        answer.picture(arguments.picture or Path(f"{arguments.file.stem}_porosity.png"), beside)
        table = answer.table()
    if arguments.json is not None:
        answer.write_json(arguments.json)
    print(table)


def _measured(arguments: argparse.Namespace) -> "Answer":
    from fdjax.app import measuring
    from fdjax.formats.gcode_layers import Choice
    from fdjax.units import length

    def optional_length(name: str) -> float | None:
        value = getattr(arguments, name)
        return None if value is None else length(value, f"--{name.replace('_', '-')}")

    filament = arguments.filament.split(",") if arguments.filament else None
    chosen = (tuple(arguments.role), tuple(arguments.object), _layers(arguments.layers))
    choice = Choice(*chosen) if any(chosen) else None
    question = measuring.Question(
        target=arguments.target,
        quantity="solid" if arguments.solid else "porosity",
        unit=arguments.unit,
        low=arguments.low,
        high=arguments.high,
        window=length(arguments.window, "--window"),
        shifted=arguments.shift,
        count=arguments.count,
        outline=arguments.outline,
        layer_height=optional_length("layer_height"),
        filament=filament and [length(each, "--filament") for each in filament],
        machine=arguments.machine,
        firmware=arguments.firmware,
        choice=choice,
        tolerance=arguments.tolerance,
    )
    return measuring.answer(arguments.file, question)


def _share(text: str) -> float:
    """A number over 0 and up to 1."""
    value = float(text)
    if not 0 < value <= 1:
        raise ValueError
    return value


def _layers(text: str | None) -> tuple[int, int] | None:
    """First and last layer of a text such as 3:9, :9, 3: or 3."""
    if text is None:
        return None
    first, _, last = text.partition(":") if ":" in text else (text, "", text)
    try:
        return int(first or 1), int(last or 10**9)
    except ValueError:
        raise InputError(f"--layers: {text!r}; as 1:20 is needed") from None


def _send(arguments: argparse.Namespace) -> None:
    from dataclasses import fields

    from fdjax.app.sending import Request, send

    send(Request(**{field.name: getattr(arguments, field.name) for field in fields(Request)}))


def _virtual(arguments: argparse.Namespace) -> None:
    from fdjax.app import playing

    if arguments.replay is not None:
        playing.replay(arguments.firmware, arguments.machine, arguments.replay, arguments.printed)
    else:
        playing.serve(arguments.firmware, arguments.machine, arguments.pace)


def _machines(arguments: argparse.Namespace) -> None:
    from fdjax.app import machines

    print(machines.description(arguments.name) if arguments.name else machines.listing())


class _Progress:
    """Shows one line of progress on stderr: rewritten in place on a terminal, else line by line."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._quiet = arguments.quiet
        self._in_place = sys.stderr.isatty()

    def __call__(self, text: str) -> None:
        if not self._quiet:
            start, end = ("\r", "\x1b[K") if self._in_place else ("", "\n")
            print(start + text, end=end, file=sys.stderr, flush=True)

    def __enter__(self) -> "_Progress":
        return self

    def __exit__(self, *_: object) -> None:
        if self._in_place and not self._quiet:
            print(file=sys.stderr)


def _prepare_jax() -> None:
    """float64, and compiled code kept between runs (in `JAX_COMPILATION_CACHE_DIR` if set).

    Comes before any module that loads NumPy, whose threads are counted as it is loaded.
    """
    # The elimination's small blocks gain nothing from BLAS threads, which spin on a busy machine.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Tracing leaves many small objects that stay: to look through them for rings takes long.
    gc.set_threshold(1_000_000)
    import jax

    jax.config.update("jax_enable_x64", True)
    # JAX adds its options to `config` as it runs.
    folder = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    if folder is None:
        cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
        folder = os.path.join(cache, "fdjax", "jax")
        jax.config.update("jax_compilation_cache_dir", folder)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    from fdjax import programs

    # JAX takes a bucket's address as well.
    programs.keep(None if "://" in str(folder) else Path(folder) / "programs")


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from importlib.metadata import version

        print(f"fdjax {version('fdjax')}")
        parser.exit()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="fdjax",
        description="Toolpaths for fused deposition with the porosity you ask for.",
        epilog="Exit codes: 0 done, 2 bad input, 3 the design failed, 4 a print stopped.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and leave")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    design = commands.add_parser("design", help="design the roads of a job and write its files")
    design.set_defaults(command=_design)
    design.add_argument("job", type=Path, metavar="JOB", help="job file, TOML")
    design.add_argument("--out", type=Path, required=True, metavar="DIR", help="output folder")
    design.add_argument(
        "--force-export", action="store_true", help="write machine files even if the design fails"
    )
    design.add_argument("--quiet", action="store_true", help="print errors only")

    measure = commands.add_parser(
        "measure", help="measure the porosity of a machine file against a target"
    )
    measure.set_defaults(command=_measure)
    add = measure.add_argument
    add("file", type=Path, metavar="FILE", help="G-code or SML file")
    asked = 'porosity asked: a formula such as "0.9 - 0.4*x/80", a picture or a .npy array'
    add("--target", required=True, metavar="EXPR|FILE", help=asked)
    add("--solid", action="store_true", help="the target is the solid share, not the porosity")
    add("--unit", default="mm", help="length unit of x and y in the formula (default mm)")
    add("--low", type=float, default=0.0, help="what black, or a value 0, stands for (default 0)")
    add("--high", type=float, default=1.0, help="what white, or a value 1, stands for (default 1)")
    add("--window", default="5mm", metavar="LENGTH", help="side of the windows (default 5mm)")
    add("--shift", action="store_true", help="shift all windows by half a window")
    counted = "what counts as solid: volume laid (default), or what is covered, seen from above"
    add("--count", choices=("volume", "coverage"), default="volume", help=counted)
    outline = "what the layers fill (default: what the file says, else told from its roads)"
    add("--outline", metavar="FILE|WKT", help=outline)
    add("--layer-height", metavar="LENGTH", help="instead of what the file says")
    diameter = "filament diameter instead of what the file says; of several tools 1.75,2.85"
    add("--filament", metavar="LENGTH", help=diameter)
    speaks = ("marlin", "klipper", "rrf", "grbl")
    add("--firmware", choices=speaks, help="whose reading of G-code holds, where readings differ")
    roles = "measure these roads alone, as infill, perimeter, support; all for every one"
    add("--role", action="append", default=[], metavar="ROLE", help=roles)
    things = "measure these objects alone, by the names that the slicer gives them"
    add("--object", action="append", default=[], metavar="NAME", help=things)
    add("--layers", metavar="A:B", help="measure these layers alone, counted from 1")
    add("--machine", metavar="NAME|FILE", help="machine profile instead of what the file says")
    scale = "error at which the picture's colours end (default 0.02)"
    add("--tolerance", type=_share, default=0.02, metavar="SHARE", help=scale)
    place = "where the picture goes (default FILE's name with _porosity.png, here)"
    add("--picture", type=Path, metavar="PNG", help=place)
    add("--json", type=Path, metavar="FILE", help="write all numbers to this file")

    send = commands.add_parser("send", help="check a machine file and stream it to a printer")
    send.set_defaults(command=_send)
    add = send.add_argument
    add("file", type=Path, metavar="FILE", help="G-code or SML file")
    add("--machine", required=True, metavar="NAME|FILE", help="profile of the machine")
    add("--port", metavar="PORT", help="as /dev/ttyUSB0, COM3 or virtual:marlin")
    speaks = ("auto", "marlin", "klipper", "rrf", "grbl", "sml")
    add("--firmware", choices=speaks, help="instead of what the profile says")
    add("--baud", type=int, metavar="N", help="instead of what the profile says")
    add("--dry-run", action="store_true", help="check and sum up; send nothing")
    add("--yes", action="store_true", help="begin without asking, and take no keys")
    where = send.add_mutually_exclusive_group()
    where.add_argument("--resume", action="store_true", help="go on with a print that broke off")
    where.add_argument(
        "--layer", type=int, metavar="N", help="go on at the beginning of this layer"
    )
    add("--kept-power", action="store_true", help="the machine still knows where it is")
    add("--log", type=Path, metavar="FILE", help="every byte, with its time (default FILE.log)")
    add("--printed", type=Path, metavar="FILE", help="save what a virtual machine laid down")
    add("--quiet", action="store_true", help="print errors only")

    virtual = commands.add_parser(
        "virtual", help="play a machine at a pseudo-terminal, or play a log back to one"
    )
    virtual.set_defaults(command=_virtual)
    add = virtual.add_argument
    add("firmware", choices=("marlin", "klipper", "rrf", "grbl", "fdm1650"), help="what it plays")
    add("--machine", metavar="NAME|FILE", help="profile of the machine that it plays")
    add("--pace", type=float, default=1.0, help="seconds that a second of it takes (default 1)")
    add("--replay", type=Path, metavar="LOG", help="take what a log says was sent, and leave")
    add("--printed", type=Path, metavar="FILE", help="with --replay: save what it laid down")

    machines = commands.add_parser("machines", help="list the machine profiles, or show one")
    machines.set_defaults(command=_machines)
    machines.add_argument("name", nargs="?", metavar="NAME", help="profile's name or file")
    return parser
