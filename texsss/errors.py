"""What can go wrong, by class.

Every message is one sentence: who, what was expected, what came, what to try.
"""


class TexsssError(Exception):
    """Base of all errors that texsss raises for a user's input or a failed computation."""


class AssetError(TexsssError, ValueError):
    """A file that is missing, unreadable, empty or not what it claims to be."""


class TooLarge(AssetError):
    """A file with more of something than allowed: `actual` faces or pixels where `limit` may be."""

    def __init__(self, message: str, limit: int, actual: int):
        super().__init__(message)
        self.limit, self.actual = limit, actual


class LimitError(AssetError):
    """A file that takes more time or memory to read than it may."""


class ShapeError(TexsssError, ValueError):
    """A tensor, map or list whose shape does not fit its neighbours."""


class DomainError(TexsssError, ValueError):
    """A value outside the range where it means something."""


class ConvergenceError(TexsssError):
    """An iteration that did not reach its tolerance."""


class Cancelled(TexsssError):
    """The caller asked for the computation to stop; nothing was written."""
