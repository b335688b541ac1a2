"""Virtual machines: for tests, for trial and for learning. They interpret what they are sent.

`virtual:marlin?faults=0.02&seed=7` is a port like any other.
"""

from urllib.parse import parse_qsl

from fdjax.errors import InputError
from fdjax.formats.profile import Machine
from fdjax.machine.virtual.base import AbstractVirtualMachine
from fdjax.machine.virtual.faults import Faults
from fdjax.machine.virtual.fdm1650 import VirtualFdm1650
from fdjax.machine.virtual.grbl import VirtualGrbl
from fdjax.machine.virtual.klipper import VirtualKlipper
from fdjax.machine.virtual.marlin import VirtualMarlin
from fdjax.machine.virtual.port import VirtualPort
from fdjax.machine.virtual.rrf import VirtualRepRapFirmware

MACHINES: dict[str, type[AbstractVirtualMachine]] = {
    "marlin": VirtualMarlin,
    "klipper": VirtualKlipper,
    "rrf": VirtualRepRapFirmware,
    "grbl": VirtualGrbl,
    "fdm1650": VirtualFdm1650,
}
"""By what follows `virtual:` in the name of a port."""

_FLAGS = {
    "marlin": ("advanced", "keepalive", "emergency_parser", "wait", "bare_resend"),
    "grbl": ("buffer_report",),
}
_ANSWERS = ("lose answer", "double answer", "lose byte", "damage byte", "delay")


def faults(machine: str, rate: float, seed: int, *, buffer_report: bool = False) -> Faults | None:
    """Faults of the kinds that the guarantee for a machine covers, at a rate from 0 to 1.

    `buffer_report`: whether a grbl tells its buffer; else it must not be taken to acknowledge more
    than it does.
    """
    if rate == 0:
        return None
    if machine == "marlin":
        return Faults(seed, rate)
    if machine == "rrf":
        return Faults(
            seed,
            rate,
            toward=("lose byte", "double byte", "damage byte"),
            back=("lose answer", "lose byte", "damage byte"),
        )
    if machine == "grbl" and not buffer_report:
        return Faults(seed, rate, toward=(), back=("lose answer", "lose byte", "delay"))
    invented = b"\x06" if machine == "fdm1650" else b"ok\n"
    return Faults(seed, rate, toward=(), back=(*_ANSWERS, "invent ok"), acknowledgement=invented)


def open_port(spec: str, machine: Machine) -> VirtualPort:
    """The port of a virtual machine: its name, and settings after a question mark.

    `pace`: seconds that a second of the machine takes (0: at once); `faults`: share of frames and
    answers that suffer one; `seed`; `record=1`: what it lays down is kept; for Marlin and grbl
    their own switches, as `advanced=0` or `buffer_report=1`. Raises `InputError` for what is
    unknown.
    """
    name, _, query = spec.partition("?")
    if name not in MACHINES:
        raise InputError(f"port virtual:{name}: no such machine; known are {', '.join(MACHINES)}")
    settings = {"pace": "0", "faults": "0", "seed": "0", "record": "0"}
    flags = _FLAGS.get(name, ())
    for key, value in parse_qsl(query, keep_blank_values=True):
        if key not in settings and key not in flags:
            known = ", ".join([*settings, *flags])
            raise InputError(f"port virtual:{name}: unknown setting {key!r}; known are {known}")
        settings[key] = value
    try:
        numbers = {key: float(value) for key, value in settings.items()}
    except ValueError:
        raise InputError(f"port virtual:{name}: settings are numbers, as in ?pace=1") from None
    options = {key: bool(numbers[key]) for key in flags if key in numbers}
    pace, record = numbers["pace"], bool(numbers["record"])
    return VirtualPort(
        MACHINES[name](machine, pace=pace, record=record, **options),
        faults=faults(
            name,
            numbers["faults"],
            int(numbers["seed"]),
            buffer_report=options.get("buffer_report", False),
        ),
        realtime=pace > 0,
    )
