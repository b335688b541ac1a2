"""What a port is to a stream: bytes there and back, and a clock; whatever is at its other end."""

from abc import ABC, abstractmethod

from fdjax.errors import FdjaxError


class PortLost(FdjaxError):
    """The port is gone: the cable, the machine's power, or its driver."""


class AbstractPort(ABC):
    """Bytes to and from a machine, and the clock by which waits are meant.

    Every method that touches the line raises `PortLost` once it is gone.
    """

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Send bytes."""

    @abstractmethod
    def read(self, seconds: float) -> bytes:
        """What has arrived; waits for at most so long where there is nothing."""

    @abstractmethod
    def now(self) -> float:
        """Seconds since some moment."""

    @abstractmethod
    def wait(self, seconds: float) -> None:
        """Let time pass."""

    @abstractmethod
    def close(self) -> None:
        """Let go of the port; harmless if it is gone."""

    @abstractmethod
    def reopen(self) -> bool:
        """Look once for the same machine after it was lost; whether the port is open again."""
