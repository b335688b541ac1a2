"""A stream at a terminal: what it shows, and how it is told what to do."""

import signal
import sys
import threading
from types import FrameType

from fdjax.machine.stream import Event, Stream
from fdjax.machine.surveyed import Survey

# A closed terminal ends a print as safely as Ctrl-C does; Windows has no such signal.
_SIGNALS = [getattr(signal, n) for n in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, n)]


def clock(seconds: float) -> str:
    """A duration for people."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s"


class Controls:
    """Ctrl-C aborts safely, a second one stops at once; lines typed at a terminal do more."""

    def __init__(self, stream: Stream, unattended: bool) -> None:
        self._stream = stream
        self._interrupts = 0
        self._typed = not unattended and sys.stdin.isatty()

    def __enter__(self) -> None:
        self._before = {number: signal.signal(number, self._interrupt) for number in _SIGNALS}
        if self._typed:
            print("p: pause, r: resume, a: abort, !: emergency stop (each with Enter)")
            threading.Thread(target=self._listen, daemon=True).start()

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        self._interrupts += 1
        if self._interrupts == 1:
            self._stream.abort()
        else:
            self._stream.emergency_stop()

    def _listen(self) -> None:
        orders = {
            "p": self._stream.pause,
            "r": self._stream.resume,
            "a": self._stream.abort,
            "!": self._stream.emergency_stop,
        }
        for line in sys.stdin:
            order = orders.get(line.strip().lower())
            if order is not None:
                order()


class Progress:
    """One line: layer, share, time left, temperatures; faults and messages above it."""

    _BAR = 24

    def __init__(self, found: Survey, quiet: bool) -> None:
        self._survey = found
        self._quiet = quiet
        self._in_place = sys.stderr.isatty()
        self._heat: dict[str, tuple[float, float]] = {}
        self._shown = ""

    def __call__(self, event: Event) -> None:
        self._heat.update(event.values)
        if self._quiet:
            return
        if event.kind in ("fault", "state"):
            self._print(event.text, end="\n")
        elif self._in_place or event.kind in ("layer", "done"):
            line = self._line(event)
            if line != self._shown:
                self._shown = line
                self._print(line, end="" if self._in_place else "\n")

    def _print(self, text: str, end: str) -> None:
        start = "\r\x1b[K" if self._in_place else ""
        try:
            print(start + text, end=end, file=sys.stderr, flush=True)
        except OSError:  # the terminal was closed; the print goes on, or is aborted by its signal
            self._quiet = True

    def _line(self, event: Event) -> str:
        left = 0.0 if event.kind == "done" else self._left(event.line, event.layer)
        share = 1 - left / self._survey.seconds if self._survey.seconds else 0.0
        bar = "#" * round(self._BAR * share)
        heat = "".join(f"  {k} {a:.0f}/{w:.0f}" for k, (a, w) in self._heat.items())
        layers = f"layer {event.layer}/{len(self._survey.layers)}"
        return f"{layers}  [{bar:.<{self._BAR}}] {100 * share:3.0f} %  {clock(left)} left{heat}"

    def _left(self, line: int, layer: int) -> float:
        """Seconds of motion after a line, evenly over the lines of its layer."""
        layers, total = self._survey.layers, self._survey.seconds
        first, began = (layers[layer - 1].line, layers[layer - 1].seconds) if layer else (1, 0.0)
        last, ends = (
            (layers[layer].line, layers[layer].seconds)
            if layer < len(layers)
            else (self._survey.lines + 1, total)
        )
        done = (line - first + 1) / max(last - first, 1)
        return max(total - began - min(done, 1.0) * (ends - began), 0.0)

    def close(self) -> None:
        if self._in_place and not self._quiet:
            print(file=sys.stderr)
