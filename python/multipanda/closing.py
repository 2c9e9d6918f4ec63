"""What is closed by leaving `with`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TypeVar

T = TypeVar("T", bound="Closing")


class Closing(ABC):
    """`with X(...) as x:` closes x at its end, by an exception too."""

    @abstractmethod
    def close(self) -> None:
        """Ends it."""

    def __enter__(self: T) -> T:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self.close()
