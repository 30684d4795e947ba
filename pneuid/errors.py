"""The one error type whose message is meant for the person at the terminal."""

from __future__ import annotations


class UserError(ValueError):
    """Input that cannot be used; the message is one line: what, where, allowed, what to do.

    Commands print it and exit with status 2; it never carries a traceback to the user.
    """


class ComputationError(RuntimeError):
    """A computation that failed on usable input; commands print it and exit with status 1."""
