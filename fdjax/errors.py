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
