"""What can go wrong, as one family of exceptions."""


class FdjaxError(Exception):
    """Root of every error that fdjax raises on purpose."""


class InputError(FdjaxError, ValueError):
    """Something a user gave cannot be used; the message is one line: what, where, what would do.

    The command line prints it and exits with code 2.
    """


class DesignError(FdjaxError):
    """A design folded, did not converge, missed its tolerance or breaks a machine limit.

    The command line prints it and exits with code 3; no machine file is written.
    """


class StreamError(FdjaxError):
    """A print that had begun stopped before its end.

    The command line prints it and exits with code 4.

    - `line`: of the file, the first that is not known to have been run; `sent`: the last that was
      sent. Everything before `line` was run once, nothing after `sent` was.
    """

    def __init__(self, message: str, *, line: int = 0, sent: int = 0) -> None:
        super().__init__(message)
        self.line = line
        self.sent = sent
